"""The wire of a link: frames through the bus process, and supervision of the node during a wait."""

from __future__ import annotations

import time
from collections.abc import Sequence

from inkloop_hardware.errors import AnotherMaster, NodeStopped, StopRequested
from inkloop_hardware.link.node_watch import because
from inkloop_hardware.link.supervision import Supervision
from inkloop_hardware.protocol.codec import Frame
from inkloop_hardware.protocol.vocabulary import Node

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
        return time.monotonic()

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
        now = time.monotonic()
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
