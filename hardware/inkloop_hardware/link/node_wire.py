"""The way of a link through the bus process, with an eye on the node while something is waited for."""

from __future__ import annotations

import time
from collections.abc import Sequence

from inkloop_hardware.errors import AnotherMaster, NodeStopped, StopRequested
from inkloop_hardware.link.node_watch import because
from inkloop_hardware.link.supervision import Supervision
from inkloop_hardware.protocol.codec import Frame
from inkloop_hardware.protocol.vocabulary import Node

LAST_WORD = 0.25
"""Seconds that a node that fell to SAFE or FAULT is given to answer what it was asked."""


class NodeWire:
    """The wire of a link: frames through the bus process, signs of life and the node's state while it waits."""

    def __init__(self, supervision: Supervision, node: Node) -> None:
        self._supervision = supervision
        self._node = node
        self._answer_id = supervision.codec.answer_id(node)
        self._falls: int | None = None
        self._fell_at: float | None = None

    def send(self, frames: Sequence[Frame]) -> None:
        """Sends frames in this order."""
        self._supervision.bus.send(frames)

    def receive(self, wait_s: float) -> bytes | None:
        """Data of the next ISO-TP frame of the node, None if none comes within `wait_s`."""
        return self._supervision.bus.receive(self._answer_id, wait_s)

    def now(self) -> float:
        """Seconds of a clock that only goes forward."""
        return time.monotonic()

    def begin(self) -> None:
        """A request begins: from now on a fall of the node matters."""
        self._supervision.keep_alive()
        self._falls, self._fell_at = self._supervision.watch(self._node).falls, None

    def check(self) -> None:
        """Says that the control loop lives; NodeLost, or NodeStopped if the node fell and does not say so itself."""
        self._supervision.keep_alive()
        self._supervision.check((self._node,))
        watch = self._supervision.watch(self._node)
        if watch.falls == self._falls:
            return
        now = time.monotonic()
        if self._fell_at is None:
            self._fell_at = now
        if now - self._fell_at > LAST_WORD:
            words = f"the {self._node.lower()} took its de-energised state{because(watch.fault)} while it was asked; "
            raise NodeStopped(words + self._advice(), watch.fault)

    def _advice(self) -> str:
        try:
            self._supervision.check_alone()
        except (AnotherMaster, StopRequested) as others:
            return str(others)
        return "mend the cause and clear it"
