"""The next prints: all points with further seeds until a mean is known, or the trials of a search by Optuna.

A plan depends on the records of whole batches only, never on the order in which prints end. Each trial has a sampler of
its own, seeded by the seed of the search and the number of the trial: a resumed search asks for the same points.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from inkloop.errors import require
from inkloop_lab.sweep.figures import scaled
from inkloop_lab.sweep.sampling import Distribution
from inkloop_lab.sweep.study import Study
from inkloop_lab.sweep.tables import OptimiseTable, Until
from inkloop_lab.sweep.task import Record, Task

if TYPE_CHECKING:
    import optuna


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


class OptimisePlan:
    """Trials in batches of `at_once`, each batch planned from all earlier ones. Raises InkloopError without Optuna."""

    def __init__(self, study: Study, table: OptimiseTable) -> None:
        require("optuna", f"{study.path}: [optimise]")
        import optuna

        optuna.logging.set_verbosity(logging.WARNING)
        self._optuna, self._study, self._table = optuna, study, table
        self.aim = f"smallest {table.minimise}" if table.minimise else f"largest {table.maximise}"
        self._search = optuna.create_study(direction="minimize" if table.minimise else "maximize")
        self._spaces = {key: _space(optuna, spread) for key, spread in study.search.items()}
        self._asked: list[optuna.Trial] = []
        self._settings: list[dict[str, Any]] = []
        self._values: list[float] = []
        self._ended: dict[int, dict[int, Record]] = {}

    @property
    def total(self) -> int:
        """Prints."""
        return self._table.trials * self._study.tables.seeds.count

    @property
    def settings(self) -> Sequence[Mapping[str, Any]]:
        """The keys of each trial so far."""
        return self._settings

    @property
    def values(self) -> Sequence[float]:
        """The objective of each finished trial, the mean over its seeds; NaN of a trial that failed."""
        return self._values

    @property
    def best(self) -> int | None:
        """The number of the best trial, the first of several; None before one has ended well."""
        sign = 1.0 if self._table.minimise else -1.0
        known = [number for number, value in enumerate(self._values) if math.isfinite(value)]
        return min(known, key=lambda number: sign * self._values[number], default=None)

    def begin(self) -> Iterator[Task]:
        """The tasks of the first batch."""
        return self._batch()

    def after(self, record: Record) -> Sequence[Task]:
        """The tasks of the next batch, once all of this one have ended."""
        count = self._study.tables.seeds.count
        self._ended.setdefault(record.point, {})[record.replicate] = record
        first = len(self._values)
        if any(len(self._ended.get(number, {})) < count for number in range(first, len(self._asked))):
            return ()
        for number in range(first, len(self._asked)):
            prints = self._ended.pop(number)
            value = float(np.mean([self._table.expression(prints[each].metrics) for each in range(count)]))
            if math.isfinite(value):
                self._search.tell(self._asked[number], value)
            else:
                self._search.tell(self._asked[number], state=self._optuna.trial.TrialState.FAIL)
            self._values.append(value)
        return list(self._batch())

    def _batch(self) -> Iterator[Task]:
        first = len(self._asked)
        for number in range(first, min(first + self._table.at_once, self._table.trials)):
            seed = int(np.random.SeedSequence([self._table.seed, number]).generate_state(1)[0])
            self._search.sampler = self._optuna.samplers.TPESampler(seed=seed)
            trial = self._search.ask(self._spaces)
            self._asked.append(trial)
            self._settings.append({key: _value(self._study.search[key], trial.params[key]) for key in self._spaces})
        for number in range(first, len(self._asked)):
            for replicate in range(self._study.tables.seeds.count):
                seed = self._study.first_seed + replicate
                yield Task(number, replicate, seed, self._settings[number])


def _space(optuna: Any, spread: Distribution) -> Any:
    """The range of a key for Optuna; a choice by its place in the list, as values may be lists or tables."""
    if spread.kind == "choice":
        return optuna.distributions.CategoricalDistribution(tuple(range(len(spread.parameters))))
    low, high = spread.parameters
    if spread.kind == "integers":
        return optuna.distributions.IntDistribution(low, high)
    return optuna.distributions.FloatDistribution(float(low), float(high), log=spread.kind == "loguniform")


def _value(spread: Distribution, found: Any) -> Any:
    return spread.parameters[found] if spread.kind == "choice" else found
