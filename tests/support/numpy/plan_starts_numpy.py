"""Changes of plans as the horizon recedes, in NumPy, to check controller/core/planner/plan_starts.c."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from inkloop_controller.core import bindings
from inkloop_controller.problem.horizon_problem import HorizonProblem, IntPlan, full_layers


def shifted(last: IntPlan, problem: HorizonProblem) -> IntPlan:
    """The rest of the last plan (layers, nx, ny), its last layer once more, without what may not fall any longer."""
    ahead = np.minimum(np.arange(1, problem.layers + 1), len(last) - 1)
    plan = np.array(last[ahead], np.int32)
    plan[~_may_fall(plan, problem)] = 0
    return plan


def postponed(last: IntPlan, problem: HorizonProblem) -> IntPlan:
    """The rest of the last plan after as many empty layers as make a plan, without what may not fall any longer."""
    plan = np.zeros((problem.layers, *last.shape[1:]), np.int32)
    plan[problem.layers + 1 - len(last) :] = last[1:]
    plan[~_may_fall(plan, problem)] = 0
    return plan


def squeezed(longer: IntPlan, problem: HorizonProblem) -> IntPlan:
    """A plan for one layer more without its first layer, whose droplets fall in the first later layer that is free.

    What may not fall in its new place becomes the kind that may.
    """
    plan = _allowed(longer[1:], problem)
    for i, j in np.argwhere(longer[0] > 0):
        free = np.flatnonzero((plan[:, i, j] == 0) & (problem.choices[:, i, j] > 0))[:1]
        fallen = np.full_like(plan, longer[0, i, j])
        plan[free, i, j] = _allowed(fallen, problem)[free, i, j]
    return plan


def without_idle_start(plan: IntPlan, problem: HorizonProblem) -> IntPlan:
    """The plan with its empty first layers moved to its end; what may not fall so early becomes the kind that may."""
    filled = np.flatnonzero(plan.reshape(len(plan), -1).max(axis=1))
    if not filled.size or filled[0] == 0:
        return plan
    return _allowed(np.roll(plan, -int(filled[0]), axis=0), problem)


def best_of(plans: Sequence[IntPlan], problem: HorizonProblem) -> IntPlan:
    """The plan with the lowest objective, the first of equal ones, moved so that it begins with a layer.

    Empty layers that move to the end hide what the last droplets leave to chance: the higher objective counts.
    """
    moved = [(without_idle_start(plan, problem), plan) for plan in plans]
    return min(moved, key=lambda pair: max(bindings.objective(problem, plan).value for plan in pair))[0]


def _allowed(plan: IntPlan, problem: HorizonProblem) -> IntPlan:
    return np.where(_may_fall(plan, problem), plan, full_layers(problem))


def _may_fall(plan: IntPlan, problem: HorizonProblem) -> NDArray[np.bool_]:
    bits = np.left_shift(1, np.maximum(plan - 1, 0))
    return np.asarray((plan == 0) | (problem.choices & bits > 0), np.bool_)
