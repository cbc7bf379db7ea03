"""The best plan for a layer problem, from the C search core: relaxed, rounded, repaired, and compared."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from inkloop.component import FloatMap
from inkloop_controller.core.bindings import answered, checked, objective_of, pointer, problem_struct
from inkloop_controller.core.library import library
from inkloop_controller.core.structs import AfterSweep, FinishStruct, PlanReportStruct, PlanWorkStruct
from inkloop_controller.planning.layer_plan import LeftOut, PlanStatus
from inkloop_controller.problem.horizon_problem import KINDS_MAX, HorizonProblem, IntPlan, Objective, SearchProgress

RelaxedStart: TypeAlias = FloatMap | Literal["gradient"] | None
"""Droplets of any size (layers, nx, ny) to be rounded, those that projected gradients find, or no such start."""

Finish: TypeAlias = Literal["even", "fast"]
"""How a print ends: as even as it can, or in fewer layers."""

_FINISHES = ("even", "fast")  # from 1 on, as in shortest_plan.h
_STARTS = ("nothing", "full layers", "last plan", "relaxation", "longer plan")
_PHASES = ("relaxation", "rounding", "repair")
_RELAX_HERE, _RELAX_GIVEN, _RELAX_NOTHING = range(3)  # of plan_work.h


@dataclass(frozen=True)
class Ending:
    """What a `Finish` chooses: layers ahead, those on a plant that is not the model's, and what a layer must gain
    (Criterion).
    """

    horizon: int
    foreign_horizon: int
    layer_worth: float


def ending_of(finish: Finish) -> Ending:
    """The choice of controller/core/planner/shortest_plan.c. Raises ValueError for another word."""
    if finish not in _FINISHES:
        raise ValueError(f"finish is {finish!r}; needs one of {', '.join(_FINISHES)}")
    chosen = FinishStruct()
    library().inkloop_finish(1 + _FINISHES.index(finish), chosen)
    return Ending(chosen.horizon, chosen.foreign_horizon, chosen.layer_worth)


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
    problem: HorizonProblem,
    work: PlanWorkStruct,
    *,
    relaxed: RelaxedStart = "gradient",
    last: IntPlan,
    seconds_max: float,
    after_sweep: Callable[[SearchProgress], bool] | None = None,
) -> FoundPlan:
    """The best plan found (controller/core/planner/shortest_plan.h); its first layer is not empty unless all are.

    work: what it may take (plan_work.h); last: (layers, nx, ny) the last plan, of any number of layers; that of another
    grid is not used; seconds_max: guard by the clock, instead of that of `work`; after_sweep: sees each sweep of a
    repair, True ends them, as does Ctrl-C.
    """
    asked, is_given = AfterSweep(after_sweep), isinstance(relaxed, np.ndarray)
    droplets = checked("relaxed", relaxed, "f8", problem.choices.shape) if isinstance(relaxed, np.ndarray) else None
    rest = _usable(problem, last)
    work.relaxation = _RELAX_GIVEN if is_given else _RELAX_HERE if relaxed == "gradient" else _RELAX_NOTHING
    work.relaxed = None if droplets is None else pointer(droplets)
    work.last = None if rest is None else pointer(rest)
    work.last_layers, work.seconds_max, work.after_sweep = len(last), seconds_max, asked.callback
    plan, report = np.empty(problem.choices.shape, np.int32), PlanReportStruct()
    answered(library().inkloop_plan(problem_struct(problem), work, pointer(plan), report))
    asked.was_interrupted()
    return FoundPlan(
        plan=plan,
        objective=objective_of(report.objective),
        status=list(PlanStatus)[report.status],
        start=_STARTS[report.start] + (", annealed" if report.is_annealed else ""),
        sweeps=report.sweeps,
        seconds=dict(zip(_PHASES, report.seconds, strict=True)),
        left_out=LeftOut(report.left_out),
    )


def _usable(problem: HorizonProblem, last: IntPlan) -> IntPlan | None:
    """The last plan for C; None if it is of another grid. Raises ValueError for values that no plan has."""
    if last.shape[1:] != problem.height.shape or not len(last):
        return None
    plan = checked("last", last, "i4", last.shape)
    if plan.min() < 0 or plan.max() > KINDS_MAX:
        raise ValueError(f"last holds {plan.min()} to {plan.max()}; needs 0 to {KINDS_MAX}, 1 + a kind of droplet")
    return plan
