"""Times as texts."""

from __future__ import annotations

from inkloop.limits import duration_text
from inkloop.units import MS_PER_S, NS_PER_S, US_PER_S


def scaled(time_s: float) -> str:
    """A time in the unit that reads best."""
    if time_s >= 1.0:
        return duration_text(time_s)
    for unit, factor in (("ms", MS_PER_S), ("us", US_PER_S)):
        if time_s * factor >= 1.0:
            return f"{time_s * factor:.3g} {unit}"
    return f"{time_s * NS_PER_S:.3g} ns"
