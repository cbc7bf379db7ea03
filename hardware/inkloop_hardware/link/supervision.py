"""Supervision in both directions: the master keeps its heartbeat alive and watches the nodes and other masters."""

from __future__ import annotations

import logging
from collections.abc import Container, Iterable

from inkloop_hardware.bus.connection import BusConnection
from inkloop_hardware.bus.fmu_connection import FmuConnection
from inkloop_hardware.bus.heartbeat import Enables
from inkloop_hardware.errors import AnotherMaster, BusDisconnected, FrameError, HardwareError, NodeLost, StopRequested
from inkloop_hardware.link.node_watch import BusWatch, NodeWatch
from inkloop_hardware.protocol.codec import Codec, Frame
from inkloop_hardware.protocol.records import KINDS, MasterAlive, Node, NodeFault, NodeStatus, StopRequest, unpack
from inkloop_hardware.replay.replay_connection import ReplayConnection

LOG = logging.getLogger("inkloop_hardware")
KEEP_ALIVE_PERIOD_S = 0.02
"""Seconds between two messages of the control loop that keep the heartbeat alive, at least."""
FIRST_BEATS = 0.15
"""Seconds of heartbeat before the first request: a node that knows this session from before takes the first frame of a
new counter for a jump."""
LISTEN_PAUSE_S = 0.02
LISTEN_SILENCES = 1.25
"""Silences without another master before the first heartbeat: a node may have taken the last frame late (assumed)."""
ENDING_SILENCES = 3.0
"""Silences for which another master may still be heard when this one opens: a run that was killed (assumed)."""

Bus = BusConnection | FmuConnection | ReplayConnection


class Supervision:
    """Watches the nodes and other masters on an open bus, and keeps the heartbeat of this master alive.

    codec: of the frames; session: our own; place: the bus, for messages; silence_s: seconds of silence until a node is
    lost, or another master forgotten. To be used by one thread.
    """

    def __init__(self, codec: Codec, session: int, place: str, silence_s: float) -> None:
        self.codec = codec
        self._session = session
        self._place = place
        self._silence_s = silence_s
        self._bus: Bus | None = None
        self._enables = Enables.NONE
        self._keep_alive_due = 0.0
        self._beating_since = 0.0
        self._watches = {node: NodeWatch(node, silence_s) for node in Node}
        self._bus_watch = BusWatch(session)
        self._senders = {
            codec.message(name).frame_id: node
            for name, (kind, node) in KINDS.items()
            if node is not None or kind in (MasterAlive, StopRequest)
        }

    @property
    def supervised_ids(self) -> Container[int]:
        """Arbitration ids of the frames that are watched."""
        return self._senders

    @property
    def bus(self) -> Bus:
        """The bus process; HardwareError while the bus is closed."""
        if self._bus is None:
            raise HardwareError("the bench is not open: attach to it first")
        return self._bus

    @property
    def is_open(self) -> bool:
        """Whether there is a bus."""
        return self._bus is not None

    @property
    def enables(self) -> Enables:
        """Outputs that the present step may energise."""
        return self._enables

    @property
    def is_settled(self) -> bool:
        """Whether the nodes have received the heartbeat long enough to take requests."""
        return self.bus.now() - self._beating_since > FIRST_BEATS

    def open(self, bus: Bus) -> None:
        """Supervise this bus and begin the heartbeat; earlier statuses of the nodes are discarded.

        The heartbeat begins once no other master has been heard for the silence after which nodes forget it: earlier,
        they would take this master for a second one. AnotherMaster if one is active, which then is not disturbed.
        """
        self._watches = {node: NodeWatch(node, self._silence_s) for node in Node}
        self._bus_watch = BusWatch(self._session)
        self._bus = bus
        try:
            if bus.is_live:
                self._listen()
        except BaseException:
            self.close()
            raise
        self._beating_since = bus.now()
        self.keep_alive()

    def close(self) -> None:
        """Close the bus: enables drop, the heartbeat ends."""
        self.bus.close()
        self._take_frames()
        self._bus = None
        self._enables = Enables.NONE

    def keep_alive(self) -> None:
        """Report that the control loop runs, and take the frames that the nodes sent meanwhile.

        BusError when the bus process ended, with its message.
        """
        self.bus.check()
        now = self.bus.now()
        if now >= self._keep_alive_due:
            self._keep_alive_due = now + KEEP_ALIVE_PERIOD_S
            self.bus.send_keep_alive(self._enables)
        self._take_frames()

    def enable(self, enables: Enables) -> None:
        """Enable these outputs and no others, from now on."""
        self._enables = enables
        self.bus.send_keep_alive(enables)

    def check(self, nodes: Iterable[Node]) -> None:
        """Check that nodes are alive: NodeLost for one that has sent no status, is silent for three cycles (300 ms) or
        cannot be trusted; BusDisconnected while the adapter is missing.
        """
        self._take_frames()
        if self.bus.disconnected:
            self._beating_since = self.bus.now()  # the nodes must receive the heartbeat again before any request
            raise BusDisconnected(self.bus.disconnected)
        now = self.bus.clock
        troubles = [trouble for node in nodes if (trouble := self._watches[node].trouble(now)) is not None]
        if troubles:
            raise NodeLost(f"{self._place}: {'; '.join(troubles)}")

    def check_alone(self) -> None:
        """AnotherMaster or StopRequested while one of them is on the bus."""
        self._take_frames()
        now = self.bus.clock
        if (message := self._bus_watch.stop_request(now)) is not None:
            raise StopRequested(f"{self._place}: {message}")
        if (message := self._bus_watch.other_master(now)) is not None:
            raise AnotherMaster(f"{self._place}: {message}")

    def watch(self, node: Node) -> NodeWatch:
        """Status, falls and fault of a node."""
        return self._watches[node]

    def _listen(self) -> None:
        """Wait for the silence of other masters, by the clock of the received frames."""
        began = None
        while True:
            self.bus.check()
            self._take_frames()
            now = self.bus.clock
            began = now if began is None and now > 0.0 else began
            if began is not None:
                if now - max(began, self._bus_watch.other_at) > LISTEN_SILENCES * self._silence_s:
                    return
                if now - began > ENDING_SILENCES * self._silence_s:
                    self.check_alone()
            self.bus.sleep(LISTEN_PAUSE_S)

    def _take_frames(self) -> None:
        """Take statuses and faults of all nodes, and messages of the bus process."""
        while self.bus.messages:
            LOG.warning("%s", self.bus.messages.popleft())
        while self.bus.others:
            now, frame = self.bus.others.popleft()
            try:
                self._take(now, frame)
            except FrameError as error:
                LOG.warning("%s", error)

    def _take(self, now: float, frame: Frame) -> None:
        if frame.arbitration_id not in self._senders:
            return
        node = self._senders[frame.arbitration_id]
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
