"""The best plan of a small problem by looking at every one of them."""

from __future__ import annotations

import numpy as np

from inkloop.component import FloatMap
from inkloop_controller.core import bindings
from inkloop_controller.problem.horizon_problem import HorizonProblem, IntPlan


def best_plan(problem: HorizonProblem) -> IntPlan:
    """The plan (2, nx, ny) with the lowest objective of all 4^cells: two layers of one pass in one ink, any cell.

    The surface after the last layer is linear in the droplets of that layer, so one product of matrices gives it for
    all patterns at once.
    """
    shape, cells = problem.height.shape, problem.height.size
    patterns = (np.arange(2**cells)[:, None] >> np.arange(cells) & 1).astype(np.int32)
    best, chosen = np.inf, (patterns[0], patterns[0])
    for first in patterns:
        below = bindings.layer(problem.height, first.reshape(shape), problem.kinds)
        surfaces = below.ravel() + patterns @ _increments(below, problem)
        error = np.abs(problem.target.ravel() - surfaces).mean(axis=1)
        values = problem.alpha * error + (1.0 - problem.alpha) * surfaces.std(axis=1)
        last = int(values.argmin())
        if values[last] < best:
            best, chosen = values[last], (first, patterns[last])
    return np.reshape(chosen, (2, *shape))


def _increments(below: FloatMap, problem: HorizonProblem) -> FloatMap:
    """Height that a droplet on each cell adds to the surface (cells, cells) [m]."""
    single = np.eye(below.size, dtype=np.int32).reshape(-1, *below.shape)
    return np.stack([(bindings.layer(below, droplet, problem.kinds) - below).ravel() for droplet in single])
