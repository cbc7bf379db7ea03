"""Wall times of calls, by the median of several rounds."""

from __future__ import annotations

from collections.abc import Callable
from statistics import median
from time import perf_counter

from inkloop.limits import duration_text
from inkloop.units import MS_PER_S, NS_PER_S, US_PER_S


def seconds(call: Callable[[], object], *, at_least_s: float = 0.2, rounds: int = 5) -> float:
    """Median time of one call [s] over rounds that each last long enough to be measured."""
    begin = perf_counter()
    call()
    once = max(perf_counter() - begin, 1e-9)
    repeats = max(1, round(at_least_s / rounds / once))
    return median(_round(call, repeats) for _ in range(rounds))


def _round(call: Callable[[], object], repeats: int) -> float:
    begin = perf_counter()
    for _ in range(repeats):
        call()
    return (perf_counter() - begin) / repeats


def scaled(time_s: float) -> str:
    """A time in the unit that reads best."""
    if time_s >= 1.0:
        return duration_text(time_s)
    for unit, factor in (("ms", MS_PER_S), ("us", US_PER_S)):
        if time_s * factor >= 1.0:
            return f"{time_s * factor:.3g} {unit}"
    return f"{time_s * NS_PER_S:.3g} ns"
