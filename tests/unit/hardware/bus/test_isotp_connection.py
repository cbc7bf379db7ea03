"""A connection to a node ends every wait."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle

import pytest
from udsoncan.exceptions import TimeoutException

from inkloop_hardware.bus.isotp_connection import ANSWER_LIMIT, IsoTpConnection
from inkloop_hardware.protocol.codec import Frame

STILL_BUSY = bytes((3, 0x7F, 0x31, 0x78))
SECOND = 1.0


class BusyNode:
    """The wire to a node that says once a second that it is still busy."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._coming = cycle([STILL_BUSY, None])

    def begin(self) -> None:
        """Nothing to begin."""

    def check(self) -> None:
        """Nothing to watch."""

    def send(self, frames: Sequence[Frame]) -> None:
        """Taken."""

    def now(self) -> float:
        return self.seconds

    def receive(self, wait_s: float) -> bytes | None:
        data = next(self._coming)
        self.seconds += SECOND if data else 0.0
        return data


def test_node_that_is_busy_for_ever_is_given_up() -> None:
    wire = BusyNode()
    connection = IsoTpConnection(wire, 0x601, 0x581, lambda request, answer: True)
    connection.specific_send(b"\x31\x01\x02\x03")

    def answers() -> set[bytes]:
        return {connection.specific_wait_frame(5.0) for _ in range(10 * round(ANSWER_LIMIT / SECOND))}

    with pytest.raises(TimeoutException):
        answers()
    assert wire.seconds == pytest.approx(ANSWER_LIMIT, abs=3 * SECOND)
