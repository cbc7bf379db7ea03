"""The bench of the master: one bus, four nodes, one heartbeat, shared by printer and profiler."""

from __future__ import annotations

import logging
import secrets
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Self

from inkloop_hardware.bus.fmu_bus import INTERFACE as FMU
from inkloop_hardware.bus.fmu_connection import connected
from inkloop_hardware.bus.heartbeat import Enables
from inkloop_hardware.bus.settings import BusSettings, interface_of, lock_channel
from inkloop_hardware.errors import (
    AnotherMaster,
    BusDisconnected,
    BusError,
    HardwareError,
    NodeLost,
    NodeStopped,
    StopRequested,
)
from inkloop_hardware.link.link import Link, LinkCounts
from inkloop_hardware.link.node_watch import because
from inkloop_hardware.link.supervision import Bus, Supervision
from inkloop_hardware.protocol.codec import Codec, Frame
from inkloop_hardware.protocol.records import Node, NodeStatus
from inkloop_hardware.replay.replay_connection import INTERFACE, ReplayConnection

ANSWER_GRACE_S = 0.25
"""Seconds for a node that went to SAFE or FAULT to answer the present request itself."""


class NodeWire:
    """Exchanges frames with one node; a wait keeps the heartbeat alive and ends when the node is lost or stops."""

    def __init__(self, supervision: Supervision, node: Node) -> None:
        self._supervision = supervision
        self._node = node
        self._answer_id = supervision.codec.answer_id(node)
        self._falls: int | None = None
        self._fell_at: float | None = None

    def send(self, frames: Sequence[Frame]) -> None:
        """Send frames in this order."""
        self._supervision.bus.send(frames)

    def receive(self, wait_s: float) -> bytes | None:
        """Data of the next ISO-TP frame of the node, None if none comes within `wait_s`."""
        return self._supervision.bus.receive(self._answer_id, wait_s)

    def now(self) -> float:
        """Seconds of a clock that only goes forward."""
        return self._supervision.bus.now()

    def begin(self) -> None:
        """Begin a request: from now on a stop of the node ends it."""
        self._supervision.keep_alive()
        self._falls, self._fell_at = self._supervision.watch(self._node).falls, None

    def check(self) -> None:
        """Keep the heartbeat alive; NodeLost, or NodeStopped if the node stopped and does not report that in its
        answer.
        """
        self._supervision.keep_alive()
        self._supervision.check((self._node,))
        watch = self._supervision.watch(self._node)
        if watch.falls == self._falls:
            return
        now = self.now()
        if self._fell_at is None:
            self._fell_at = now
        if now - self._fell_at > ANSWER_GRACE_S:
            message = f"the {self._node.lower()} took its de-energised state{because(watch.fault)} during a request; "
            raise NodeStopped(message + self._advice(), watch.fault)

    def _advice(self) -> str:
        try:
            self._supervision.check_alone()
        except (AnotherMaster, StopRequested) as others:
            return str(others)
        return "remove the cause and clear it"


LOG = logging.getLogger("inkloop_hardware")
PAUSE = 0.02
"""Seconds between two checks of the nodes in `wait_for`."""
SILENCES = 15
SESSION_MAX, JOB_MAX = 0xFFFF, 0xFFFFFFFF


class Rig:
    """A bus with its nodes, shared by several users.

    The first `attach` opens it and listens for another master, the last `detach` closes it. A separate process owns the
    adapter and sends MasterAlive every 100 ms, as long as this one keeps it alive: by `keep_alive`, and by waiting in a
    link. Changes of nodes are logged as sentences by the logger "inkloop_hardware".

    settings: the bus; folder: of a relative traffic log; valid_share: cells that the first scan must see; on_part: the
    bed need not be empty. To be used by one thread.
    """

    def __init__(
        self, settings: BusSettings, *, folder: Path | None = None, valid_share: float = 0.0, on_part: bool = True
    ) -> None:
        self.settings = settings
        self.folder = folder
        self.valid_share, self.on_part = valid_share, on_part
        self.codec = Codec()
        is_simulated = interface_of(settings) == FMU  # a bench of its own, whose runs repeat frame by frame
        self._session = 1 if is_simulated else 1 + secrets.randbelow(SESSION_MAX)
        self._job = 1 if is_simulated else 1 + secrets.randbelow(JOB_MAX)
        self._users = 0
        self._on_close = ExitStack()
        self.supervision = Supervision(self.codec, self._session, str(settings), settings.silence_s)
        self._links: dict[Node, Link] = {}

    @property
    def session(self) -> int:
        """Random number of this master, 1 to 65535."""
        return self._session

    @property
    def is_open(self) -> bool:
        """Whether the bus is open."""
        return self.supervision.is_open

    @property
    def job(self) -> int:
        """The print job, 1 to 2^32 - 1; random unless set. It belongs to the state of a run: a resumed run continues
        its job. May be set at any time while nothing is enabled; ValueError for a number out of range.
        """
        return self._job

    @job.setter
    def job(self, number: int) -> None:
        if not 1 <= number <= JOB_MAX:
            raise ValueError(f"job is {number}, expected 1 to {JOB_MAX}")
        if self.supervision.enables:
            raise HardwareError("the job cannot change while a step is enabled")
        self._job = number
        if self.is_open:
            self.supervision.bus.send_job(number)

    def attach(self) -> None:
        """Add a user; the first one opens the bus, and listens a little longer than `settings.silence_s` before its
        heartbeat begins.

        BusError if it cannot be opened, AnotherMaster if one is active, on the bus or, by the lock of the channel, on
        this machine; the user is not added then.
        """
        if self._users == 0:
            try:
                self._open()
            except BaseException:
                self._on_close.close()
                raise
        self._users += 1

    def detach(self) -> None:
        """Remove a user; with the last one enables drop, the heartbeat ends, the traffic log and the bus are closed.
        Does nothing without an `attach`, so every clean-up may call it.
        """
        if self._users == 1 and self.is_open:
            with self._on_close:
                self.supervision.close()
            self._log_counts()
        self._users = max(0, self._users - 1)

    def __enter__(self) -> Self:
        self.attach()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.detach()

    def link(self, node: Node) -> Link:
        """The link to one node; always the same object. To be used while attached."""
        if node not in self._links:
            wire, place = NodeWire(self.supervision, node), str(self.settings)
            self._links[node] = Link(node, self.codec, wire, place, answer_s=self.settings.answer_s)
        return self._links[node]

    def keep_alive(self) -> None:
        """Report that the control loop runs, and take the frames that the nodes sent meanwhile.

        To be called at least every `settings.grace_s` while something is enabled (a waiting link does so), and once per
        do_step otherwise. BusError when the bus process ended, with its message.
        """
        self.supervision.keep_alive()

    def pause(self, seconds: float) -> None:
        """Keep alive, then let time pass."""
        self.keep_alive()
        self.supervision.bus.sleep(seconds)

    @contextmanager
    def enabled(self, *, lamp: bool = False, gate: bool = False, motion: bool = False) -> Iterator[None]:
        """Enable lamp, gate or motion for one step; nothing is enabled after it, even after an error. Not to be nested.

        AnotherMaster or StopRequested while one of them is on the bus.
        """
        if self.supervision.enables:
            raise HardwareError("a step is enabled already; enables belong to one step at a time")
        self.check_alone()
        wanted = (Enables.LAMP * lamp) | (Enables.GATE * gate) | (Enables.MOTION * motion)
        try:
            self.supervision.enable(Enables(wanted))
            yield
        finally:
            with suppress(BusError):  # without a bus process nothing is enabled; the next call reports what happened
                self.supervision.enable(Enables.NONE)

    def wait_for(self, nodes: Iterable[Node], limit_s: float | None = None) -> None:
        """Wait until the frames of all `nodes` arrive and can be trusted; NodeLost names those that do not.

        limit_s: None is fifteen times the silence after which a node is lost.
        """
        limit_s = SILENCES * self.settings.silence_s if limit_s is None else limit_s
        bus = self.supervision.bus
        wanted, until = tuple(nodes), bus.now() + limit_s
        while True:
            self.keep_alive()
            if bus.now() > until:
                return self.supervision.check(wanted)
            with suppress(NodeLost, BusDisconnected):
                self.supervision.check(wanted)
                if self.supervision.is_settled:
                    return
            bus.sleep(PAUSE)

    def check_alone(self) -> None:
        """AnotherMaster or StopRequested while one of them is on the bus."""
        self.supervision.check_alone()

    def status(self, node: Node) -> NodeStatus | None:
        """The last intact status of a node, None before the first."""
        return self.supervision.watch(node).status

    def _open(self) -> None:
        log = self.settings.traffic_log
        if log is not None and self.folder is not None:
            log = self.folder / log
        settings = replace(self.settings, traffic_log=log)
        bus: Bus
        if settings.interface == INTERFACE:
            bus = ReplayConnection(settings)
            self._job = bus.job
        else:
            answers = [self.codec.answer_id(node) for node in Node]
            self._on_close.callback(lock_channel(self.settings))
            bus = connected(settings, self._session, self._job, answers, self.supervision.supervised_ids)
            LOG.info("the heartbeat has %s", bus.priority)
        LOG.info("%s is open, session %d, job %d", self.settings, self._session, self._job)
        self.supervision.open(bus)

    def _log_counts(self) -> None:
        for link in self._links.values():
            if (counts := link.counts) != LinkCounts():
                LOG.info(
                    "%s: %d requests sent again, %d answers late or doubled, %d frames out of order, "
                    "%d transfers restarted",
                    *(link.node.lower(), counts.repeated, counts.stray, counts.broken, counts.restarted),
                )
