"""Plans of problems that no controller has built, with work of any amount."""

from __future__ import annotations

from math import inf

from inkloop_controller.core.structs import PlanWorkStruct
from inkloop_controller.planning.horizon_planner import FoundPlan, RelaxedStart
from inkloop_controller.planning.horizon_planner import best_plan as core_plan
from inkloop_controller.problem.horizon_problem import HorizonProblem, IntPlan
from inkloop_controller.problem.work import Work


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
    """The core's plan; layer_worth: what a layer must gain (Criterion); seed: of the annealing."""
    budget = PlanWorkStruct(
        layer_worth=layer_worth,
        sweeps=work.sweeps,
        annealing_sweeps=-1 if work.annealing_sweeps is None else work.annealing_sweeps,
        iterations=work.iterations,
        seed=seed,
        threads=work.threads,
    )
    return core_plan(problem, budget, relaxed=relaxed, last=last, seconds_max=seconds_max)
