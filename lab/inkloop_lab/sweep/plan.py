"""The next prints: all points with their seeds, and further seeds until a mean is known well enough.

A plan depends on the records of whole batches only, never on the order in which prints end.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Protocol

import numpy as np

from inkloop_lab.sweep.figures import scaled
from inkloop_lab.sweep.study import Study
from inkloop_lab.sweep.tables import Until
from inkloop_lab.sweep.task import Record, Task


class Plan(Protocol):
    """The tasks of a study."""

    @property
    def total(self) -> int:
        """Prints, as far as they are planned."""
        ...

    def begin(self) -> Iterator[Task]:
        """The first tasks."""
        ...

    def after(self, record: Record) -> Sequence[Task]:
        """The tasks that follow from the record of a task of this plan."""
        ...


class PointsPlan:
    """All points of a study: `count` seeds each, then as `[seeds] until` asks."""

    def __init__(self, study: Study) -> None:
        self._study, self._seeds = study, study.tables.seeds
        self._points: dict[int, dict[str, Any]] = {}
        self._planned: dict[int, int] = {}
        self._ended: dict[int, dict[int, Record]] = {}
        self._further = 0

    @property
    def total(self) -> int:
        """Prints, as far as they are planned."""
        return self._study.count * self._seeds.count + self._further

    def begin(self) -> Iterator[Task]:
        """The first seeds of every point."""
        for point, overrides in enumerate(self._study.points()):
            if self._seeds.until:
                self._points[point] = overrides
            yield from self._tasks(point, overrides, 0, self._seeds.count)

    def after(self, record: Record) -> Sequence[Task]:
        """Further seeds of a point once all of its earlier ones have ended."""
        until = self._seeds.until
        if until is None:
            return ()
        point = record.point
        ended = self._ended.setdefault(point, {})
        ended[record.replicate] = record
        count = self._planned.setdefault(point, self._seeds.count)
        if len(ended) < count:
            return ()
        more = seeds_wanted([ended[number] for number in range(count)], until, self._seeds.max or count)
        self._planned[point] += more
        self._further += more
        return list(self._tasks(point, self._points[point], count, more))

    def _tasks(self, point: int, overrides: dict[str, Any], first: int, count: int) -> Iterator[Task]:
        for replicate in range(first, first + count):
            yield Task(point, replicate, self._study.first_seed + replicate, overrides)


def standard_error(values: Sequence[float]) -> float:
    """Of the mean of these values; NaN of fewer than two."""
    return float(np.std(values, ddof=1)) / math.sqrt(len(values)) if len(values) > 1 else math.nan


def seeds_wanted(records: Sequence[Record], until: Until, most: int) -> int:
    """Further seeds of a point: none where the standard error is small enough, or of prints that all fail.

    As many as the scatter asks for, but no more than there are already: the scatter of few prints says little.
    """
    values = [scaled(until.metric, record.metrics[until.metric]) for record in records if record.metrics]
    if len(values) < 2:
        return 0
    error = standard_error(values)
    if error <= until.goal:
        return 0
    wanted = math.ceil(len(values) * (error / until.goal) ** 2) - len(values)
    return min(max(1, wanted), len(records), most - len(records))
