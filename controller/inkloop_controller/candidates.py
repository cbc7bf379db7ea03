"""Plans that may win, and which of them does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from inkloop_controller import core
from inkloop_controller.horizon_problem import HorizonProblem, IntPlan, Objective, SearchResult, SearchStatus
from inkloop_controller.layer_plan import PROVEN, PlanStatus
from inkloop_controller.starts import without_first_layer, without_idle_start

_STATUS = {
    SearchStatus.DONE: PlanStatus.REPAIRED,
    SearchStatus.BUDGET: PlanStatus.BUDGET,
    SearchStatus.TIME: PlanStatus.TIME_LIMIT,
    SearchStatus.STOPPED: PlanStatus.INTERRUPTED,
}


@dataclass(frozen=True)
class Candidate:
    """A plan with its objective; start: what it was made from; found: the search that repaired it (None: nobody)."""

    start: str
    plan: IntPlan
    objective: Objective
    found: SearchResult | None = None


def best_candidate(problem: HorizonProblem, candidates: Sequence[Candidate], layer_worth: float) -> Candidate:
    """The one with the lowest objective that begins with a layer; else the first of them, which does nothing.

    layer_worth: share of the objective that its first layer must gain, or the later ones come earlier without it.
    """
    nothing = candidates[0]
    ready = [_of_plan(problem, candidate, without_idle_start(candidate.plan, problem)) for candidate in candidates]
    best = min(ready, key=lambda candidate: candidate.objective.value)
    while layer_worth > 0.0 and best.plan[1:].any():
        sooner = _of_plan(problem, best, without_first_layer(best.plan, problem))
        worth = sooner.objective.value - best.objective.value
        if worth > layer_worth * best.objective.value or sooner.objective.value >= nothing.objective.value:
            break
        best = sooner
    return best


def status_of(problem: HorizonProblem, best: Candidate, bound: float) -> PlanStatus:
    """How the winner came about; bound: no plan can have a lower objective [m] (NaN: not known)."""
    if not best.plan.any():
        return PlanStatus.DONE
    if best.objective.value - bound <= PROVEN * problem.kinds[0].layer_height:
        return PlanStatus.OPTIMAL
    if best.found is None:
        return PlanStatus.FALLBACK
    if best.found.interrupted:
        return PlanStatus.INTERRUPTED
    return _STATUS[best.found.status]


def _of_plan(problem: HorizonProblem, candidate: Candidate, plan: IntPlan) -> Candidate:
    if plan is candidate.plan:
        return candidate
    return replace(candidate, plan=plan, objective=core.objective(problem, plan))
