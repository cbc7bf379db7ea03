"""The layer problem of the model predictive controller, solved by local search from several starts."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from inkloop.component import FloatMap, Job
from inkloop_controller import one_layer as core
from inkloop_controller.core import IntMap
from inkloop_controller.layer_model import LayerModel
from inkloop_controller.layer_plan import LayerPlan, PlanStatus
from inkloop_controller.one_layer import LayerProblem
from inkloop_controller.regions import RegionTest, materials
from inkloop_controller.relaxation import LayerRelaxation, RelaxedPlan

Relaxation: TypeAlias = Literal["none", "ipopt", "highs"]


class LayerMpc:
    """Chooses the layer that minimises alpha * mean |target - H| + (1 - alpha) * std(H) over the part.

    Every start is repaired by flips and swaps, the best result is taken, and compared with printing nothing: without
    that a small alpha trades height for evenness for ever. Below an alpha of about 0.1 it never begins: on the flat
    substrate the first layer's unevenness costs more than its height gains.

    relaxation: solver of the relaxed problem, which adds a start and a bound; sweeps: work budget of one repair;
    annealing_sweeps: work of one more start that is annealed first (0: none); region_test: see regions.
    Raises ValueError for options that cannot be meant.
    """

    def __init__(
        self,
        job: Job,
        *,
        alpha: float = 0.8,
        horizon: int = 1,
        relaxation: Relaxation = "none",
        sweeps: int = 50,
        annealing_sweeps: int = 50,
        region_test: RegionTest = "middle",
    ) -> None:
        if horizon != 1:
            raise ValueError(f"horizon is {horizon}; this version looks 1 layer ahead")
        if sweeps < 1 or annealing_sweeps < 0:
            raise ValueError(
                f"sweeps is {sweeps} and annealing_sweeps {annealing_sweeps}; needs at least 1 and at least 0"
            )
        check_single_pass(job)
        check_alpha(alpha)
        self._job, self._alpha, self._region_test = job, alpha, region_test
        self._sweeps, self._annealing_sweeps = sweeps, annealing_sweeps
        self._model = LayerModel.of(job)
        self._relaxation = None if relaxation == "none" else LayerRelaxation(job.mask, job.mask, alpha, relaxation)

    def plan(self, height: FloatMap, ink_scale: float, layer: int, last: IntMap) -> LayerPlan:
        """The best pattern found for the surface `height` (nx, ny) [m]; DONE if that is to print nothing."""
        job = self._job
        problem = layer_problem(job, height, ink_scale, self._alpha, self._region_test)
        relaxed = None if self._relaxation is None else self._relaxation.solve(problem)
        start, best = self._best(problem, self._starts(last, relaxed), random_key(job, layer))
        bound_valid = relaxed is not None and relaxed.solved
        bound = relaxed.objective if relaxed is not None and bound_valid else np.nan
        nothing = np.zeros_like(last)
        idle = core.objective(problem, nothing)
        if best.objective >= idle:
            return LayerPlan(nothing, idle, height, PlanStatus.DONE, "nothing", best.sweeps, bound, bound_valid)
        predicted = self._model.scaled(ink_scale).layer(height, best.pattern, layer + 1)
        status = PlanStatus.REPAIRED if best.finished else PlanStatus.BUDGET
        return LayerPlan(best.pattern, best.objective, predicted, status, start, best.sweeps, bound, bound_valid)

    def _starts(self, last: IntMap, relaxed: RelaxedPlan | None) -> dict[str, IntMap]:
        starts = {"nothing": np.zeros_like(last), "everything": self._job.mask.astype(np.int32), "last layer": last}
        if relaxed is not None and relaxed.solved:
            starts["relaxation"] = (self._job.mask & (relaxed.droplets >= 0.5)).astype(np.int32)
        return starts

    def _best(self, problem: LayerProblem, starts: dict[str, IntMap], key: int) -> tuple[str, core.LayerResult]:
        found = {name: core.search(problem, start, self._sweeps) for name, start in starts.items()}
        if self._annealing_sweeps:
            found["annealed"] = core.search(
                problem, starts["everything"], self._sweeps, annealing_sweeps=self._annealing_sweeps, seed=key
            )
        return min(found.items(), key=lambda item: item[1].objective)


def layer_problem(job: Job, height: FloatMap, ink_scale: float, alpha: float, test: RegionTest) -> LayerProblem:
    """The problem of the job's next layer on the surface `height` (nx, ny) [m]."""
    inks = LayerModel.of(job).scaled(ink_scale).inks
    return LayerProblem(height, job.target_height, job.mask, job.mask, materials(job, height, test), inks, alpha)


def random_key(job: Job, layer: int) -> int:
    """Key of the random numbers of one layer's search, 64 bits: the job's seed above, the layer below."""
    return (job.seed * 2**32 + layer) % 2**64


def check_single_pass(job: Job) -> None:
    """Raises ValueError for a job of several passes: over them the surface is not linear in the pattern."""
    if job.passes != 1:
        raise ValueError(f"passes is {job.passes}; this version plans layers of 1 pass (OpenLoop takes 4)")


def check_alpha(alpha: float) -> None:
    """Raises ValueError for a weight outside 0 to 1."""
    if not 0.0 <= alpha <= 1.0:
        raise ValueError(f"alpha is {alpha}; needs a weight between 0 (evenness only) and 1 (height only)")
