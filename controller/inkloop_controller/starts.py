"""Plans to begin a search from, and what is done to a plan as the horizon recedes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap
from inkloop_controller.horizon_problem import HorizonProblem, IntPlan


def no_droplets(problem: HorizonProblem) -> IntPlan:
    """Nothing in any layer."""
    return np.zeros(problem.choices.shape, np.int32)


def full_layers(problem: HorizonProblem) -> IntPlan:
    """Wherever a droplet may fall, one of the first kind that may."""
    choices = problem.choices.astype(np.int32)
    lowest = choices & -choices
    return np.where(choices > 0, np.round(np.log2(np.maximum(lowest, 1))) + 1, 0).astype(np.int32)


def even_droplets(problem: HorizonProblem) -> FloatMap:
    """What lacks on each cell in equal shares of the layers: droplets of any size (layers, nx, ny), 0 to 1."""
    lacking = (problem.target - problem.height) / (problem.layers * problem.kinds[0].layer_height)
    return np.where(problem.choices > 0, np.clip(lacking, 0.0, 1.0), 0.0)


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


def without_first_layer(plan: IntPlan, problem: HorizonProblem) -> IntPlan:
    """The plan without the droplets of its first layer, and with all others as early as can be."""
    later = plan.copy()
    later[0] = 0
    return without_idle_start(later, problem)


def _may_fall(plan: IntPlan, problem: HorizonProblem) -> NDArray[np.bool_]:
    bits = np.left_shift(1, np.maximum(plan - 1, 0))
    return np.asarray((plan == 0) | (problem.choices & bits > 0), np.bool_)
