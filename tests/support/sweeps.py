"""Studies without prints: an executor that ends tasks in any order and forgets some, and plants that are functions."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from inkloop_lab.sweep import dataset
from inkloop_lab.sweep.engine import Site, carry_out
from inkloop_lab.sweep.folder import StudyFolder
from inkloop_lab.sweep.plan import OptimisePlan, Plan, PointsPlan
from inkloop_lab.sweep.report import sweep_of
from inkloop_lab.sweep.study import Study
from inkloop_lab.sweep.task import Bundle, Record, Task
from support.places import SCENARIOS

SCENARIO = SCENARIOS / "cuboid.toml"
Work = Callable[[Task], Record]


class Shuffled(Executor):
    """An executor that ends its tasks in a random order; it is interrupted after so many of them."""

    def __init__(self, work: Work, slots: int = 3, seed: int = 0, interrupted_after: int = -1) -> None:
        self._slots, self._rng, self._is_new = slots, np.random.default_rng(seed), False
        self._tasks: list[tuple[Future[Record], Task]] = []
        self.left = interrupted_after
        self.begun: list[tuple[int, int]] = []
        self.site = Site(self, work, self.slots, BrokenProcessPool)

    def submit(self, work: Any, /, *arguments: Any, **_: Any) -> Future[Any]:
        future: Future[Record] = Future()
        (task,) = arguments
        self.begun.append(task.key)
        self._tasks.append((future, task))
        self._is_new = True
        if len(self._tasks) == self._slots:
            self._end_one()
        return future

    def slots(self) -> int:
        if self._tasks and not self._is_new:
            self._end_one()
        self._is_new = False
        return self._slots

    def interrupted(self) -> bool:
        return self.left == 0

    def _end_one(self) -> None:
        future, task = self._tasks.pop(self._rng.integers(len(self._tasks)))
        self.left -= self.left > 0
        try:
            future.set_result(self.site.work(task))
        except Exception as error:
            future.set_exception(error)


def record(task: Task, **metrics: float) -> Record:
    return Record(task.point, task.replicate, "done", metrics, wall_s=1.0)


def study(folder: Path, text: str) -> Study:
    """A study of the cuboid; text: of the file, without its scenario."""
    path = folder / "study.toml"
    path.write_text(f"scenario = {json.dumps(str(SCENARIO))}\n{text}")
    return Study.load(path)


def swept(own: Study, folder: Path, engine: Shuffled) -> tuple[xr.Dataset, Plan, list[Record]]:
    """State of a study in a folder after an engine ran, which may have held a part of it; the records that it saw."""
    plan: Plan = OptimisePlan(own, own.tables.optimise) if own.tables.optimise else PointsPlan(own)
    folder.mkdir(exist_ok=True)
    seen: list[Record] = []
    prints = StudyFolder(folder, own, Bundle.of(own.scenario.text, SCENARIO))
    carry_out(plan, engine.site, prints, engine.interrupted, seen.append)
    found = sweep_of(own, prints, plan)
    dataset.write(found, folder)
    return found, plan, seen


def ishigami(values: Sequence[Any]) -> float:
    """Ishigami and Homma (1990) with a = 7, b = 0.1; its variance and indices are known (below)."""
    x, y, z = values
    return math.sin(x) + 7.0 * math.sin(y) ** 2 + 0.1 * z**4 * math.sin(x)


_A, _B = 7.0, 0.1
_ALONE = 0.5 * (1.0 + _B * math.pi**4 / 5.0) ** 2, _A**2 / 8.0, 0.0
_TOGETHER = 8.0 * _B**2 * math.pi**8 / 225.0
ISHIGAMI = np.array([_ALONE, np.add(_ALONE, [_TOGETHER, 0.0, _TOGETHER])]) / (sum(_ALONE) + _TOGETHER)
"""First order and total of the three keys."""
