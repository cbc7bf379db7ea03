"""Monitor of the check bytes and counters of one supervised message.

With two bad frames among the last five the sender counts as missing, until fewer than two of the last five are bad.
Silence is not detected here: that needs a clock. `firmware/can/e2e_monitor.c` follows the same rules.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from enum import IntEnum

from inkloop_hardware.protocol.codec import COUNTERS

WINDOW = 5
"""Frames that count for the verdict."""
BAD_LIMIT = 2
"""Bad frames among them from which on the sender counts as missing."""
LOST_MAX = 2
"""Frames that may be lost in a row: at the third cycle the sender is missing anyway."""
STUCK_AFTER = 3
"""Repeats in a row that make a stuck counter."""


class Verdict(IntEnum):
    """Verdict on one frame; from REPEATED on the frame is bad."""

    FIRST = 0
    """no earlier frame to compare with"""
    GOOD = 1
    """the next counter"""
    LOST = 2
    """up to LOST_MAX frames are missing before it"""
    REPEATED = 3
    """the counter of the last frame"""
    JUMPED = 4
    """any other counter; the next frame is compared with it"""
    DAMAGED = 5
    """wrong check byte or a counter of 15; the next frame is compared with the last undamaged one"""

    @property
    def bad(self) -> bool:
        """Whether the frame counts against the sender."""
        return self >= Verdict.REPEATED


@dataclass
class E2eMonitor:
    """Follows one message; `damaged` to `lost` count frames, `stuck` how often the counter stood still."""

    damaged: int = 0
    repeated: int = 0
    jumped: int = 0
    lost: int = 0
    stuck: int = 0
    _last: int | None = None
    _repeats: int = 0
    _bad: deque[bool] = field(default_factory=lambda: deque(maxlen=WINDOW))

    def take(self, intact: bool, counter: int) -> Verdict:
        """Take one received frame; the verdict on it."""
        verdict = self._judge(intact, counter)
        if verdict is not Verdict.DAMAGED:
            self._last = counter
        self._repeats = self._repeats + 1 if verdict is Verdict.REPEATED else 0
        self.stuck += self._repeats == STUCK_AFTER
        self._bad.append(verdict.bad)
        return verdict

    @property
    def trusted(self) -> bool:
        """Whether the sender can be trusted: an undamaged frame came, and few of the last ones were bad."""
        return self._last is not None and sum(self._bad) < BAD_LIMIT

    def _judge(self, intact: bool, counter: int) -> Verdict:
        if not intact or not 0 <= counter < COUNTERS:
            self.damaged += 1
            return Verdict.DAMAGED
        if self._last is None:
            return Verdict.FIRST
        step = (counter - self._last) % COUNTERS
        if step == 0:
            self.repeated += 1
            return Verdict.REPEATED
        if step > 1 + LOST_MAX:
            self.jumped += 1
            return Verdict.JUMPED
        self.lost += step - 1
        return Verdict.GOOD if step == 1 else Verdict.LOST
