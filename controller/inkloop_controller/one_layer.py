"""The problem of a single layer, as a horizon of one: for callers that look no further."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inkloop.component import BoolMap, FloatMap, Ink
from inkloop_controller import core
from inkloop_controller.core import HorizonProblem, IntMap, SearchStatus


@dataclass(frozen=True)
class LayerProblem:
    """Fields as of HorizonProblem; material: (nx, ny), index into `inks` of a droplet on the cell."""

    height: FloatMap
    target: FloatMap
    part: BoolMap
    allowed: BoolMap
    material: IntMap
    inks: tuple[Ink, ...]
    alpha: float

    @property
    def horizon(self) -> HorizonProblem:
        """The same as a horizon of one layer."""
        choices = np.where(self.allowed, 1 << self.material, 0).astype(np.uint16)[None]
        return HorizonProblem(self.height, self.target, self.part, choices, self.inks, self.alpha)

    def droplets(self, pattern: IntMap) -> IntMap:
        """A pattern (not 0: a droplet of the cell's own material) as a plan of one layer."""
        return np.where(pattern != 0, 1 + self.material, 0).astype(np.int32)[None]


@dataclass(frozen=True)
class LayerResult:
    """A pattern with its objective [m]; finished: no single change improves it."""

    pattern: IntMap
    objective: float
    finished: bool
    sweeps: int


def objective(problem: LayerProblem, pattern: IntMap) -> float:
    """Objective [m] of a pattern."""
    return core.objective(problem.horizon, problem.droplets(pattern)).value


def search(
    problem: LayerProblem, start: IntMap, sweeps_max: int, *, annealing_sweeps: int = 0, seed: int = 0
) -> LayerResult:
    """As core.search."""
    return _result(
        core.search(
            problem.horizon,
            problem.droplets(start),
            sweeps_max=sweeps_max,
            annealing_sweeps=annealing_sweeps,
            seed=seed,
        )
    )


def paper_search(problem: LayerProblem, start: IntMap, batch: int, iterations_max: int, seed: int) -> LayerResult:
    """As core.paper_search."""
    return _result(core.paper_search(problem.horizon, problem.droplets(start), batch, iterations_max, seed))


def _result(found: core.SearchResult) -> LayerResult:
    return LayerResult(found.plan[0], found.objective.value, found.status is not SearchStatus.BUDGET, found.sweeps)
