"""Rules for opening a disconnected adapter again."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from inkloop_hardware.errors import BusError, BusOff

FIRST_PAUSE, LONGEST_PAUSE = 0.1, 2.0
BUS_OFF_PAUSE = 1.0
"""Seconds of silence after bus-off: 128 times 11 recessive bits are 3 ms at 500 kbit/s, the rest is for the cause."""
STABLE_AFTER = 10.0
"""Seconds after which an adapter that was opened again counts as stable."""
PROOF = 0.3
"""Seconds in which an adapter that was opened again must not fail: some open without an error and close at once."""


@dataclass
class Reopening:
    """Pauses between tries. limit_s: seconds of tries after an unplugged adapter; bus_off: it was bus-off before."""

    limit_s: float
    bus_off: bool = False
    _pause: float = FIRST_PAUSE
    _waited: float = 0.0
    _opened_at: float = -math.inf

    def opened(self, now: float) -> None:
        """Note the second at which it was opened again."""
        self._opened_at = now

    def pauses(self, error: BusError, lit: bool, now: float) -> Iterator[float]:
        """Seconds to wait before each try to open it; BusError when no try is left.

        lit: the lamp was enabled. An adapter that fails soon after it was opened again gets no additional tries. One
        that is bus-off is opened again once, and never when the lamp was on: a person must check the bench first.
        """
        if isinstance(error, BusOff):
            yield from self._after_bus_off(error, lit)
            return
        if now - self._opened_at > STABLE_AFTER:
            self._pause, self._waited = FIRST_PAUSE, 0.0
        while self._waited < self.limit_s:
            pause = self._pause
            self._waited += pause
            self._pause = min(2 * pause, LONGEST_PAUSE)
            yield pause
        raise BusError(f"{error} It could not be opened again within {self._waited:.0f} s")

    def _after_bus_off(self, error: BusError, lit: bool) -> Iterator[float]:
        if lit:
            raise BusError(
                f"{error} The lamp was enabled, so it is not opened again automatically: check the bench first"
            )
        if self.bus_off:
            raise BusError(f"{error} It was opened again once already")
        self.bus_off = True
        yield BUS_OFF_PAUSE
        raise BusError(f"{error} It could not be opened again")
