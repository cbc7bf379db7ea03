"""What is done to plans as the horizon recedes, stated in NumPy to check controller/core/planner/plan_starts.c."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from inkloop_controller.core import bindings
from inkloop_controller.model.starts import full_layers
from inkloop_controller.problem.horizon_problem import HorizonProblem, IntPlan


def shifted(last: IntPlan, problem: HorizonProblem) -> IntPlan:
    """The rest of the last plan (layers, nx, ny), its last layer once more, without what may not fall any longer."""
    ahead = np.minimum(np.arange(1, problem.layers + 1), len(last) - 1)
    plan = np.array(last[ahead], np.int32)
    plan[~_may_fall(plan, problem)] = 0
    return plan


def without_idle_start(plan: IntPlan, problem: HorizonProblem) -> IntPlan:
    """The plan with its empty first layers moved to its end; what may not fall so early becomes the kind that may."""
    filled = np.flatnonzero(plan.reshape(len(plan), -1).max(axis=1))
    if not filled.size or filled[0] == 0:
        return plan
    moved = np.roll(plan, -int(filled[0]), axis=0)
    return np.where(_may_fall(moved, problem), moved, full_layers(problem))


def best_of(plans: Sequence[IntPlan], problem: HorizonProblem) -> IntPlan:
    """The plan with the lowest objective that begins with a layer, the first of equal ones."""
    return min(
        (without_idle_start(plan, problem) for plan in plans), key=lambda plan: bindings.objective(problem, plan).value
    )


def _may_fall(plan: IntPlan, problem: HorizonProblem) -> NDArray[np.bool_]:
    bits = np.left_shift(1, np.maximum(plan - 1, 0))
    return np.asarray((plan == 0) | (problem.choices & bits > 0), np.bool_)
