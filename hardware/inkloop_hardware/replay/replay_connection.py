"""A bus that is not there: the nodes answer as they did in a recorded run.

In place of `BusConnection` for `interface = "replay"`, with a traffic log as channel. Everything above it, devices,
links, services and ISO-TP, is what runs on a bench. Time is that of the log, and nothing waits.
"""

from __future__ import annotations

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
from inkloop_hardware.protocol.vocabulary import Node
from inkloop_hardware.replay.recorded_exchanges import exchanges
from inkloop_hardware.replay.recorded_nodes import RecordedNodes
from inkloop_hardware.replay.traffic_reading import parts_of, read_traffic

INTERFACE = "replay"


class ReplayConnection:
    """Offers what `BusConnection` does. Raises BusError: no log, none of a run, ReplayDiffers, ReplayEnded.

    job: that of the recorded run. What the master says besides its requests has no meaning here.
    """

    def __init__(self, settings: BusSettings) -> None:
        if settings.channel is None:
            raise BusError("a replay needs a traffic log: set bench.channel to a .blf or .asc file")
        self.settings = settings
        self.others: deque[tuple[float, Frame]] = deque()
        self.words: deque[str] = deque()
        self.away = ""
        self.clock = 0.0
        codec = Codec()
        path = Path(settings.channel)
        parts = [read_traffic(part) for part in parts_of(path)]
        self._seen = [one for part in parts for one in part]
        self._told = 0
        begins = list(accumulate(map(len, parts)))[:-1]
        self._nodes = RecordedNodes(exchanges(self._seen, codec), path, begins)
        self.job = self._nodes.job
        self._said_by = {codec.message(f"{node}{kind}").frame_id for node in Node for kind in ("Status", "Fault")}
        self._ends = {codec.request_id(node): _End(node, codec, self._answer) for node in Node}
        self._queues = {codec.answer_id(node): self._ends[codec.request_id(node)].sent for node in Node}
        self._tell(self._nodes.first)

    def check(self) -> None:
        """Nothing can be wrong with it."""

    def send(self, frames: Sequence[Frame]) -> None:
        """What the nodes make of these frames."""
        for frame in frames:
            self._ends[frame.arbitration_id].take(frame.data)

    def receive(self, identifier: int, wait_s: float) -> bytes | None:
        """Data of the next frame with this id, None if there is none."""
        queue = self._queues[identifier]
        return queue.popleft() if queue else None

    def send_keep_alive(self, enables: Enables) -> None:
        """Nobody needs to hear it."""

    def say_stop(self, active: bool) -> None:
        """Nobody needs to hear it."""

    def say_job(self, job: int) -> None:
        """The job of a replay is that of the log."""

    def close(self) -> None:
        """Nothing to close."""

    def _answer(self, node: Node, request: bytes) -> bytes:
        answer, at = self._nodes.answer(node, request)
        self._tell(at)
        return answer

    def _tell(self, at: int) -> None:
        """What the nodes said of themselves up to this frame of the log."""
        while self._told <= at:
            seen = self._seen[self._told]
            if seen.frame.arbitration_id in self._said_by:
                self.others.append((seen.at, seen.frame))
            self.clock = seen.at
            self._told += 1


class _End:
    """A node's end of ISO-TP; `sent`: data of its frames."""

    def __init__(self, node: Node, codec: Codec, answer: Callable[[Node, bytes], bytes]) -> None:
        self.sent: deque[bytes] = deque()
        self._came: deque[bytes] = deque()
        self._node, self._answer = node, answer
        self._ids = codec.answer_id(node), codec.request_id(node)
        address = isotp.Address(isotp.AddressingMode.Normal_11bits, txid=self._ids[0], rxid=self._ids[1])
        self._stack = isotp.TransportLayerLogic(self._receive, self._send, address, params=PARAMETERS)

    def take(self, data: bytes) -> None:
        """A frame of the master; what follows from it is sent at once."""
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
