"""Plans of problems that no controller has built, with work of any amount."""

from __future__ import annotations

from dataclasses import replace
from math import inf

from inkloop.testing import job
from inkloop_controller.core.layer_step import LayerStep
from inkloop_controller.planning.horizon_planner import FoundPlan, RelaxedStart
from inkloop_controller.planning.horizon_planner import best_plan as core_plan
from inkloop_controller.problem.criterion import Work
from inkloop_controller.problem.horizon_problem import HorizonProblem, IntPlan


def best_plan(
    problem: HorizonProblem,
    work: Work,
    *,
    relaxed: RelaxedStart = "gradient",
    last: IntPlan,
    layer_worth: float,
    seed: int,
    seconds_max: float = inf,
) -> FoundPlan:
    """The core's plan; layer_worth: what a layer must gain (Criterion); seed: of the annealing, job and layer."""
    step = LayerStep(
        replace(job(), seed=seed >> 32),
        layer_worth=layer_worth,
        sweeps_max=work.sweeps,
        annealing_sweeps=work.annealing_sweeps,
        iterations=work.iterations,
        threads=work.cores,
    )
    return core_plan(step, seed % 2**32, problem, relaxed=relaxed, last=last, seconds_max=seconds_max)
