"""A wire between a link and the firmware's nodes, in one process and by an injected clock, that loses frames."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

import numpy as np

from inkloop_hardware.link.link import Link
from inkloop_hardware.protocol.codec import Codec, Frame
from inkloop_hardware.protocol.records import Node
from support.benches.node_bench import HEAD, NodeBench
from support.benches.wire_library import IsotpEnd

NODES = list(Node)
BLOCK_SIZE = 16


class FaultyWire:
    """One node behind the ISO-TP of its firmware. Each frame, either way, is lost with `loss`, comes twice with
    `repeat`, and goes through `alter` (which may change it, or drop it with None).
    """

    def __init__(
        self,
        bench: NodeBench,
        node: int = HEAD,
        *,
        seed: int = 0,
        loss: float = 0.0,
        repeat: float = 0.0,
        alter: Callable[[Frame], Frame | None] | None = None,
    ) -> None:
        self.bench = bench
        self.node = node
        self.random = np.random.default_rng(seed)
        self.loss, self.repeat, self.alter = loss, repeat, alter
        self.lost = 0
        self.end = IsotpEnd(BLOCK_SIZE, receive=0x640 + 2 * node, send=0x641 + 2 * node)
        self.waiting: deque[bytes] = deque()

    def begin(self) -> None:
        pass

    def check(self) -> None:
        pass

    def now(self) -> float:
        return self.bench.clock / 1e3

    def send(self, frames: Sequence[Frame]) -> None:
        for frame in frames:
            for got in self._through(frame):
                self.end.take(got, self.bench.clock)
                self._turn()

    def receive(self, wait_s: float) -> bytes | None:
        until = self.bench.clock + round(1e3 * wait_s)
        self._turn()
        while not self.waiting and self.bench.clock < until:
            self.bench.tick(5)
            self._turn()
        return self.waiting.popleft() if self.waiting else None

    def _turn(self) -> None:
        """One turn of the loop in node_frames.c."""
        now = self.bench.clock
        self.end.tick(now)
        if not self.end.state.is_sending:
            answer = self.bench.late(self.node)
            request = b"" if answer else self.end.receive()
            answer = answer or (self.bench.raw(request, self.node) if request else b"")
            if answer:
                self.end.send(answer)
        while (frame := self.end.next(now)) is not None:
            self.waiting.extend(got.data for got in self._through(frame))

    def _through(self, frame: Frame) -> list[Frame]:
        altered = self.alter(frame) if self.alter else frame
        if altered is None or self.random.random() < self.loss:
            self.lost += 1
            return []
        return [altered] * (2 if self.random.random() < self.repeat else 1)

    def link(self) -> Link:
        return Link(NODES[self.node], CODEC, self, "a faulty wire")


CODEC = Codec()
