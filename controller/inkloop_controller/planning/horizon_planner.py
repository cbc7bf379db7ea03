"""The best plan for a layer problem, from the C search core: relaxed, rounded, repaired, and compared."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np

from inkloop.component import FloatMap
from inkloop_controller.core.bindings import Calls, Device, answered, objective_of
from inkloop_controller.core.layer_step import LayerStep
from inkloop_controller.core.library import FinishStruct, PlanReportStruct, library, problem_struct
from inkloop_controller.planning.layer_plan import LeftOut, PlanStatus
from inkloop_controller.problem.arrays import checked, pointer
from inkloop_controller.problem.horizon_problem import KINDS_MAX, HorizonProblem, IntPlan, Objective, SearchProgress
from inkloop_controller.problem.options import variables

RelaxedStart: TypeAlias = FloatMap | Literal["gradient"] | None
"""Droplets of any size (layers, nx, ny) to be rounded, those that projected gradients find, or no such start."""

Finish: TypeAlias = Literal["even", "fast"]
"""End of a print: as even as it can, or in fewer layers."""

_STARTS = ("nothing", "full layers", "last plan", "relaxation", "longer plan")
_PHASES = ("relaxation", "rounding", "repair")
_RELAX_HERE, _RELAX_GIVEN, _RELAX_NOTHING = range(3)  # of plan_work.h


def ending_of(finish: Finish) -> Any:
    """The choice of controller/core/planner/shortest_plan.c: horizon, foreign_horizon, layer_worth."""
    chosen = FinishStruct()
    library().inkloop_finish(variables()["finish"].items[finish], chosen)
    return chosen


@dataclass(frozen=True, eq=False)
class FoundPlan:
    """A plan (layers, nx, ny), empty if nothing is better; start: what it was made from; seconds: time by phase;
    left_out: by the time limit.
    """

    plan: IntPlan
    objective: Objective
    status: PlanStatus
    start: str
    sweeps: int
    seconds: Mapping[str, float]
    left_out: LeftOut


def best_plan(
    step: LayerStep,
    layer: int,
    problem: HorizonProblem,
    *,
    relaxed: RelaxedStart = "gradient",
    last: IntPlan,
    seconds_max: float,
    device: Device | None = None,
    after_sweep: Callable[[SearchProgress], bool] | None = None,
) -> FoundPlan:
    """The best plan found (controller/core/planner/shortest_plan.h); its first layer is not empty unless all are.

    step: its options say how much work it may take; layer: number of the last layer; last: (layers, nx, ny) the last
    plan, of any number of layers; that of another grid is not used; seconds_max: guard by the clock; device: repairs
    plans in place of the core, and what it raises is raised; after_sweep: sees each sweep of a repair, True ends them,
    as does Ctrl-C.
    """
    calls = Calls(after_sweep, device)
    how, droplets = _RELAX_HERE if isinstance(relaxed, str) else _RELAX_NOTHING, None
    if isinstance(relaxed, np.ndarray):
        how, droplets = _RELAX_GIVEN, pointer(checked("relaxed", relaxed, "f8", problem.choices.shape))
    start = (how, droplets, _usable(problem, last), len(last), seconds_max, calls.device, calls.after_sweep)
    plan, report = np.empty(problem.choices.shape, np.int32), PlanReportStruct()
    task = (step.struct, layer, problem_struct(problem))
    code = library().inkloop_plan(*task, *start, pointer(plan), report)
    calls.was_interrupted()
    answered(code)
    return FoundPlan(
        plan=plan,
        objective=objective_of(report.objective),
        status=list(PlanStatus)[report.status],
        start=_STARTS[report.start] + (", annealed" if report.is_annealed else ""),
        sweeps=report.sweeps,
        seconds=dict(zip(_PHASES, report.seconds, strict=True)),
        left_out=LeftOut(report.left_out),
    )


def _usable(problem: HorizonProblem, last: IntPlan) -> Any:
    """The last plan for C; None if it is of another grid. Raises ValueError for values that no plan has."""
    if last.shape[1:] != problem.height.shape or not len(last):
        return None
    plan = checked("last", last, "i4", last.shape)
    if plan.min() < 0 or plan.max() > KINDS_MAX:
        raise ValueError(f"last holds {plan.min()} to {plan.max()}; needs 0 to {KINDS_MAX}, 1 + a kind of droplet")
    return pointer(plan)
