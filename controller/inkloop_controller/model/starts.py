"""Plans and droplets to begin a search or a solver from."""

from __future__ import annotations

import numpy as np

from inkloop.component import FloatMap
from inkloop_controller.problem.horizon_problem import HorizonProblem, IntPlan


def no_droplets(problem: HorizonProblem) -> IntPlan:
    """Nothing in any layer."""
    return np.zeros(problem.choices.shape, np.int32)


def full_layers(problem: HorizonProblem) -> IntPlan:
    """Wherever a droplet may fall, one of the first kind that may."""
    choices = problem.choices.astype(np.int32)
    lowest = choices & -choices
    return np.where(choices > 0, np.round(np.log2(np.maximum(lowest, 1))) + 1, 0).astype(np.int32)


def even_droplets(problem: HorizonProblem) -> FloatMap:
    """The missing height of each cell in equal shares of the layers: droplets of any size (layers, nx, ny), 0 to 1."""
    lacking = (problem.target - problem.height) / (problem.layers * problem.kinds[0].layer_height)
    return np.where(problem.choices > 0, np.clip(lacking, 0.0, 1.0), 0.0)
