"""Search the best setting with Optuna, by its ask-and-tell interface.

Each trial has a sampler of its own, seeded by the seed of the search and the number of the trial: a resumed search
asks for the same points.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from inkloop.errors import require
from inkloop_lab.sweep.distributions import Distribution
from inkloop_lab.sweep.study import Study
from inkloop_lab.sweep.tables import OptimiseTable
from inkloop_lab.sweep.task import Record, Task

if TYPE_CHECKING:
    import optuna


class OptimisePlan:
    """Trials in batches of `at_once`, each batch planned from all earlier ones. Raises InkloopError without Optuna."""

    def __init__(self, study: Study, table: OptimiseTable) -> None:
        require("optuna", f"{study.path}: [optimise]")
        import optuna

        optuna.logging.set_verbosity(logging.WARNING)
        self._optuna, self._study, self._table = optuna, study, table
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
