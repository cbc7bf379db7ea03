"""The bench as the master holds it: one bus, four nodes, one heartbeat, shared by printer and profiler."""

from __future__ import annotations

import logging
import secrets
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Self

from inkloop_hardware.bus.connection import BusConnection
from inkloop_hardware.bus.heartbeat import Enables
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.errors import BusAway, BusError, FrameError, HardwareError, NodeLost, NotAlone
from inkloop_hardware.link.bus_watch import BusWatch
from inkloop_hardware.link.link import Link, LinkCounts
from inkloop_hardware.link.node_watch import NodeWatch
from inkloop_hardware.link.node_wire import NodeWire
from inkloop_hardware.protocol.codec import Codec, Frame
from inkloop_hardware.protocol.records import KINDS, MasterAlive, NodeFault, NodeStatus, StopRequest, unpack
from inkloop_hardware.protocol.vocabulary import Node
from inkloop_hardware.replay.replay_connection import INTERFACE, ReplayConnection

LOG = logging.getLogger("inkloop_hardware")
WORD_CYCLE = 0.02
"""Seconds between two words of the control loop to the bus process, at least."""
PAUSE = 0.02
FIRST_BEATS = 0.15
"""Seconds of heartbeat before anything is asked: a node that knows this session from before takes the first frame of a
new counter for a jump."""
SESSION_MAX, JOB_MAX = 0xFFFF, 0xFFFFFFFF


class Rig:
    """A bus with its nodes.

    Nothing is opened before the first `attach`, everything is closed at the last `detach`. A process of its own owns
    the adapter and says every 100 ms that the master lives, as long as this one says so: by `alive`, and by waiting in
    a link. Changes of nodes go to the logger "inkloop_hardware" as sentences.

    settings: the bus; folder: of a relative traffic log. To be used by one thread.
    """

    def __init__(self, settings: BusSettings, *, folder: Path | None = None) -> None:
        self.settings = settings
        self.folder = folder
        self.codec = Codec()
        self._session = 1 + secrets.randbelow(SESSION_MAX)
        self._job = 1 + secrets.randbelow(JOB_MAX)
        self._users = 0
        self._bus: BusConnection | ReplayConnection | None = None
        self._enables = Enables.NONE
        self._word_due = 0.0
        self._opened_at = 0.0
        self._watches = {node: NodeWatch(node) for node in Node}
        self._bus_watch = BusWatch(self._session)
        self._links: dict[Node, Link] = {}
        self._said_by = {
            self.codec.message(name).frame_id: node
            for name, (kind, node) in KINDS.items()
            if node is not None or kind in (MasterAlive, StopRequest)
        }

    @property
    def session(self) -> int:
        """Number that this master took when it started, 1 to 65535."""
        return self._session

    @property
    def is_open(self) -> bool:
        """Whether the bus is open."""
        return self._bus is not None

    @property
    def job(self) -> int:
        """The print job, 1 to 2^32 - 1; random unless set. To be kept with the state of a run, so that a resumed one
        goes on with it. May be set at any time while nothing is enabled; ValueError for a number out of range."""
        return self._job

    @job.setter
    def job(self, number: int) -> None:
        if not 1 <= number <= JOB_MAX:
            raise ValueError(f"job is {number}, expected 1 to {JOB_MAX}")
        if self._enables:
            raise HardwareError("the job cannot change while a step is enabled")
        self._job = number
        if self._bus is not None:
            self._bus.say_job(number)

    def attach(self) -> None:
        """One more user; the first one opens the bus. BusError if it cannot be opened, which does not count."""
        if self._users == 0:
            self._open()
        self._users += 1

    def detach(self) -> None:
        """One user less; with the last one enables drop, the heartbeat ends, the traffic log and the bus are closed.
        Does nothing without an `attach`, so it may stand in every clean-up."""
        if self._users == 1 and self._bus is not None:
            self._bus.close()
            self._take_frames()
            self._say_counts()
            self._bus = None
            self._enables = Enables.NONE
        self._users = max(0, self._users - 1)

    def __enter__(self) -> Self:
        self.attach()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.detach()

    def link(self, node: Node) -> Link:
        """What talks to one node; always the same object. To be used while attached."""
        if node not in self._links:
            self._links[node] = Link(node, self.codec, NodeWire(self, node), str(self.settings))
        return self._links[node]

    def alive(self) -> None:
        """Says that the control loop lives, and takes note of what the nodes said meanwhile.

        To be called at least every `settings.grace_s` while something is enabled (a waiting link does so), and once per
        do_step otherwise. BusError when the bus process ended, with its words.
        """
        self.bus.check()
        now = time.monotonic()
        if now >= self._word_due:
            self._word_due = now + WORD_CYCLE
            self.bus.say_alive(self._enables)
        self._take_frames()

    @contextmanager
    def enabled(self, *, lamp: bool = False, gate: bool = False, motion: bool = False) -> Iterator[None]:
        """Enables for one step; on leaving, whatever happened, nothing is enabled any more. Not to be nested.

        NotAlone while another master speaks or somebody asks for a stop.
        """
        if self._enables:
            raise HardwareError("a step is enabled already; enables belong to one step at a time")
        self.check_alone()
        wanted = (Enables.LAMP * lamp) | (Enables.GATE * gate) | (Enables.MOTION * motion)
        try:
            self._enables = Enables(wanted)
            self.bus.say_alive(self._enables)
            yield
        finally:
            self._enables = Enables.NONE
            with suppress(BusError):  # without a bus process nothing is enabled; the next call tells what happened
                self.bus.say_alive(self._enables)

    def wait_for(self, nodes: Iterable[Node], limit_s: float = 3.0) -> None:
        """Waits until every one of `nodes` is heard and believed; NodeLost that names those that are not."""
        wanted, until = tuple(nodes), time.monotonic() + limit_s
        while True:
            self.alive()
            now = time.monotonic()
            if now > until:
                return self.check(wanted)
            with suppress(NodeLost, BusAway):
                self.check(wanted)
                if now - self._opened_at > FIRST_BEATS:
                    return
            time.sleep(PAUSE)

    def check(self, nodes: Iterable[Node]) -> None:
        """NodeLost if one of them was never heard, is silent for three cycles (300 ms) or is not to be believed;
        BusAway while the adapter is gone."""
        self._take_frames()
        if self.bus.away:
            self._opened_at = time.monotonic()  # the nodes must hear the heartbeat again before anything is asked
            raise BusAway(self.bus.away)
        now = self.bus.clock
        troubles = [trouble for node in nodes if (trouble := self._watches[node].trouble(now)) is not None]
        if troubles:
            raise NodeLost(f"{self.settings}: {'; '.join(troubles)}")

    def check_alone(self) -> None:
        """NotAlone, in words, while another master speaks on the bus or somebody asks for a stop."""
        self._take_frames()
        if (trouble := self._bus_watch.trouble(self.bus.clock)) is not None:
            raise NotAlone(f"{self.settings}: {trouble}")

    def status(self, node: Node) -> NodeStatus | None:
        """The last intact status of a node; None: none yet."""
        return self._watches[node].status

    def age(self, node: Node) -> float | None:
        """Seconds since that status came in; None: none yet."""
        at = self._watches[node].at
        return None if at is None else max(0.0, self.bus.clock - at)

    def stop_request(self, active: bool = True) -> None:
        """Asks all nodes to take their de-energised state and to stay in it, every 50 ms until called with False.
        Afterwards a person must clear them. No emergency stop."""
        self.bus.say_stop(active)

    @property
    def bus(self) -> BusConnection | ReplayConnection:
        """The bus process; HardwareError while nobody is attached."""
        if self._bus is None:
            raise HardwareError("the bench is not open: attach to it first")
        return self._bus

    def watch(self, node: Node) -> NodeWatch:
        """What a node said of itself."""
        return self._watches[node]

    def _open(self) -> None:
        log = self.settings.traffic_log
        if log is not None and self.folder is not None:
            log = self.folder / log
        settings = replace(self.settings, traffic_log=log)
        self._watches = {node: NodeWatch(node) for node in Node}
        self._bus_watch = BusWatch(self._session)
        answers = [self.codec.answer_id(node) for node in Node]
        if settings.interface == INTERFACE:
            self._bus = ReplayConnection(settings)
            self._job = self._bus.job
        else:
            self._bus = BusConnection(settings, self._session, self._job, answers, self._said_by)
        LOG.info("%s is open, session %d, job %d", self.settings, self._session, self._job)
        self._opened_at = time.monotonic()
        self.alive()

    def _say_counts(self) -> None:
        for link in self._links.values():
            if (counts := link.counts) != LinkCounts():
                LOG.info(
                    "%s: %d requests sent again, %d answers late or doubled, %d frames out of order, %d transfers anew",
                    *(link.node.lower(), counts.repeated, counts.stray, counts.broken, counts.restarted),
                )

    def _take_frames(self) -> None:
        """Status and faults of all nodes, and words of the bus process."""
        while self.bus.words:
            LOG.warning("%s", self.bus.words.popleft())
        while self.bus.others:
            now, frame = self.bus.others.popleft()
            try:
                self._take(now, frame)
            except FrameError as error:
                LOG.warning("%s", error)

    def _take(self, now: float, frame: Frame) -> None:
        if frame.arbitration_id not in self._said_by:
            return
        node = self._said_by[frame.arbitration_id]
        reading = self.codec.decode(frame)
        record = unpack(self.codec, reading) if reading.intact else None
        if isinstance(record, MasterAlive):
            self._bus_watch.take_master(now, record)
        elif isinstance(record, StopRequest):
            self._bus_watch.take_stop(now, record)
        elif isinstance(record, NodeFault):
            self._watches[record.node].take_fault(record)
        elif node is not None and reading.message == f"{node}{NodeStatus.message}":
            status = record if isinstance(record, NodeStatus) else None
            self._watches[node].take_status(now, status, reading.counter or 0)
