"""How much work a layer may take."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np

from inkloop_controller.horizon_problem import HorizonProblem

ONE_LAYER_ANNEALING = 50  # sweeps: these reach the proven optima of small grids (by trial)
SMALL_LAYER = 20_000  # cells of a single layer up to which annealing is worth its time (assumed)
SMALL_PLAN = 1000  # values of a plan of several layers up to which it is (by trial)
SMALL_ANNEALING = 40_000  # values drawn for such a plan, in at most 200 sweeps (by trial)


@dataclass(frozen=True)
class Work:
    """Budgets of one layer, in work so that the same bits come out everywhere.

    sweeps: of the repair of one start; annealing_sweeps: of one more start that is annealed first (None: 50 for
    a single layer, up to 200 for a small plan of several, none for a large one), with it every start;
    iterations: of the relaxation; threads: does not change the answer; time_limit: guard by the clock [s].
    Raises ValueError, all faults in one sentence, for budgets that cannot be meant.
    """

    sweeps: int = 30
    annealing_sweeps: int | None = None
    iterations: int = 10
    threads: int = 1
    time_limit: float = inf

    def __post_init__(self) -> None:
        least = {"sweeps": 1, "annealing_sweeps": 0, "iterations": 1, "threads": 1}
        faults = [
            f"{name} is {getattr(self, name)}; needs at least {bound}"
            for name, bound in least.items()
            if (value := getattr(self, name)) is not None and value < bound
        ]
        if not self.time_limit > 0.0:
            faults.append(f"time_limit is {self.time_limit}; needs a time above 0 s")
        if faults:
            raise ValueError("; ".join(faults))

    def annealing_of(self, problem: HorizonProblem) -> int:
        """Annealing sweeps for a problem."""
        if self.annealing_sweeps is not None:
            return self.annealing_sweeps
        values = int(np.count_nonzero(problem.choices)) + 1
        if problem.layers == 1:
            return ONE_LAYER_ANNEALING if values <= SMALL_LAYER else 0
        return min(200, SMALL_ANNEALING // values) if values <= SMALL_PLAN else 0


DEFAULT_WORK = Work()
