"""A bus connection without a bus: the nodes answer as they did in a recorded run.

It replaces `BusConnection` for `interface = "replay"`, with a traffic log as channel. Everything above it, devices,
links, services and ISO-TP, is the same as on a bench. Time is that of the log, and nothing waits.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from itertools import accumulate
from pathlib import Path

import isotp

from inkloop_hardware.bus.heartbeat import Enables
from inkloop_hardware.bus.isotp_connection import PARAMETERS
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.errors import BusError
from inkloop_hardware.protocol.codec import Codec, Frame
from inkloop_hardware.protocol.records import Node
from inkloop_hardware.replay.recorded_exchanges import exchanges, parts_of, read_traffic
from inkloop_hardware.replay.recorded_nodes import RecordedNodes

INTERFACE = "replay"


class ReplayConnection:
    """The interface of `BusConnection` on a traffic log. Raises BusError: no log, no log of a run, ReplayDiffers,
    ReplayEnded.

    job: that of the recorded run. Frames of the master other than its requests have no meaning here.
    """

    is_live = False
    now, sleep = staticmethod(time.monotonic), staticmethod(time.sleep)

    def __init__(self, settings: BusSettings) -> None:
        if settings.channel is None:
            raise BusError("a replay needs a traffic log: set bench.channel to a .blf or .asc file")
        self.settings = settings
        self.others: deque[tuple[float, Frame]] = deque()
        self.messages: deque[str] = deque()
        self.disconnected = ""
        self.clock = 0.0
        codec = Codec()
        path = Path(str(settings.channel))
        parts = [read_traffic(part) for part in parts_of(path)]
        self._seen = [one for part in parts for one in part]
        self._passed = 0
        begins = list(accumulate(map(len, parts)))[:-1]
        self._nodes = RecordedNodes(exchanges(self._seen, codec), path, begins)
        self.job = self._nodes.job
        self._said_by = {codec.message(f"{node}{kind}").frame_id for node in Node for kind in ("Status", "Fault")}
        self._ends = {codec.request_id(node): _End(node, codec, self._answer) for node in Node}
        self._queues = {codec.answer_id(node): self._ends[codec.request_id(node)].sent for node in Node}
        self._pass_on(self._nodes.first)

    def check(self) -> None:
        """A replay cannot fail here."""

    def send(self, frames: Sequence[Frame]) -> None:
        """Pass frames to the nodes, which answer at once."""
        for frame in frames:
            self._ends[frame.arbitration_id].take(frame.data)

    def receive(self, identifier: int, wait_s: float) -> bytes | None:
        """Data of the next frame with this id, None if there is none."""
        queue = self._queues[identifier]
        return queue.popleft() if queue else None

    def send_keep_alive(self, enables: Enables) -> None:
        """Nothing to keep alive."""

    def send_job(self, job: int) -> None:
        """The job of a replay is that of the log."""

    def close(self) -> None:
        """Nothing to close."""

    def _answer(self, node: Node, request: bytes) -> bytes:
        answer, at = self._nodes.answer(node, request)
        self._pass_on(at)
        return answer

    def _pass_on(self, at: int) -> None:
        """Move statuses and faults up to this frame of the log to `others`."""
        while self._passed <= at:
            seen = self._seen[self._passed]
            if seen.frame.arbitration_id in self._said_by:
                self.others.append((seen.at, seen.frame))
            self.clock = seen.at
            self._passed += 1


class _End:
    """The ISO-TP of one node; `sent`: data of its frames."""

    def __init__(self, node: Node, codec: Codec, answer: Callable[[Node, bytes], bytes]) -> None:
        self.sent: deque[bytes] = deque()
        self._came: deque[bytes] = deque()
        self._node, self._answer = node, answer
        self._ids = codec.answer_id(node), codec.request_id(node)
        address = isotp.Address(isotp.AddressingMode.Normal_11bits, txid=self._ids[0], rxid=self._ids[1])
        self._stack = isotp.TransportLayerLogic(self._receive, self._send, address, params=PARAMETERS)

    def take(self, data: bytes) -> None:
        """Take a frame of the master; resulting frames are sent at once."""
        self._came.append(data)
        self._stack.process(0.0)
        while (request := self._stack.recv()) is not None:
            self._stack.send(self._answer(self._node, bytes(request)))
            self._stack.process(0.0)

    def _receive(self, _wait_s: float) -> isotp.CanMessage | None:
        if not self._came:
            return None
        data = self._came.popleft()
        return isotp.CanMessage(arbitration_id=self._ids[1], dlc=len(data), data=data)

    def _send(self, message: isotp.CanMessage) -> None:
        self.sent.append(bytes(message.data))
