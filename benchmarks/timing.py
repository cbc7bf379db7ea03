"""Times of calls, and tables of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from time import perf_counter, process_time
from typing import Generic, NamedTuple, TypeVar

from rich.table import Table

from inkloop.limits import duration_text
from inkloop.units import MS_PER_S, NS_PER_S, US_PER_S

T = TypeVar("T")


class Timed(NamedTuple, Generic[T]):
    """Result of a call, and its processor and wall time [s]."""

    answer: T
    processor_s: float
    wall_s: float


def timed(call: Callable[[], T]) -> Timed[T]:
    """Call once."""
    processor, wall = process_time(), perf_counter()
    answer = call()
    return Timed(answer, process_time() - processor, perf_counter() - wall)


def least(call: Callable[[], object], rounds: int) -> float:
    """The least processor time of some calls [s]."""
    return min(timed(call).processor_s for _ in range(rounds))


def table_of(title: str, headings: Iterable[str], *, texts: int = 0) -> Table:
    """A table without rows; its first columns are texts, the others numbers."""
    table = Table(title=title)
    for number, heading in enumerate(headings):
        table.add_column(heading, justify="left" if number < texts else "right")
    return table


def scaled(time_s: float) -> str:
    """A time in the unit that reads best."""
    if time_s >= 1.0:
        return duration_text(time_s)
    for unit, factor in (("ms", MS_PER_S), ("us", US_PER_S)):
        if time_s * factor >= 1.0:
            return f"{time_s * factor:.3g} {unit}"
    return f"{time_s * NS_PER_S:.3g} ns"
