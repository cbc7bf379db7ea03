"""Controllers that use the present height deficit, without an objective and without prediction."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from inkloop.component import BoolMap, FloatMap, Job
from inkloop_controller.baselines.planners import judged, one_layer
from inkloop_controller.core.bindings import diffuse
from inkloop_controller.estimation.height_estimator import Estimate
from inkloop_controller.model.droplet_choices import DropletChoices, RegionTest
from inkloop_controller.model.layer_model import ink_maps
from inkloop_controller.planning.layer_plan import LayerPlan
from inkloop_controller.problem.horizon_problem import IntMap, IntPlan
from inkloop_controller.problem.options import Length, Option

REACH = 2  # cells: footprints of droplets that far apart still overlap


class CohenLipson:
    """Greedy geometric feedback (Cohen, Lipson 2010): drop where most is lacking, until too little is lacking anywhere.

    Lacking is the target minus the map predicted so far, weighted with the footprint that a droplet of the cell has on
    flat ground, over the part. A cell gets one droplet per layer at most. threshold: what must be lacking for a droplet
    [m]; None: half of what the weighted droplet itself adds, from where it lowers the sum of squares of the predicted
    map. Raises ValueError for a threshold below 0.
    """

    def __init__(
        self,
        job: Job,
        *,
        threshold: Annotated[float | None, Option("um", form=Length | None)] = None,
        region_test: Annotated[RegionTest, Option()] = "middle",
    ) -> None:
        if threshold is not None and not threshold >= 0.0:
            raise ValueError(f"threshold is {threshold}; needs a height of at least 0")
        self._job, self._threshold = job, threshold
        self._problems = one_layer(job, DropletChoices(job, region_test=region_test), alpha=1.0)

    def plan(self, estimate: Estimate, layer: int, last: IntPlan, elapsed: float = 0.0) -> LayerPlan:
        """All droplets that the greedy choice drops on the surface; DONE if that is none."""
        material = self._problems.materials(estimate.height)
        dropped = self.droplets(estimate.height, ink_maps(estimate.inks, material))
        pattern = np.where(dropped, 1 + material, 0).astype(np.int32)
        return judged(self._job, estimate, layer, pattern, "greedy choice")

    def droplets(self, height: FloatMap, ink: tuple[FloatMap, FloatMap, FloatMap]) -> BoolMap:
        """Where the greedy choice drops, (nx, ny), for heights h1, h2, h3 of each cell's ink [m].

        A sweep drops on all cells that come first within the reach of their own footprint: what is lacking there is
        touched by nothing that would be dropped before, so that the sweeps end as the choice one by one does.
        """
        part = self._job.mask
        lacking = np.where(part, self._job.target_height - height, 0.0)
        weight = np.where(part, _gathered(part.astype(np.float64), ink), 1.0)
        squares = _gathered(part.astype(np.float64), (ink[0] ** 2, ink[1] ** 2, ink[2] ** 2))
        threshold = squares / (2.0 * weight) if self._threshold is None else np.full(part.shape, self._threshold)
        dropped = np.zeros(part.shape, np.bool_)
        while True:
            weighted = _gathered(lacking, ink) / weight
            may = part & ~dropped & (weighted > threshold)
            if not may.any():
                return dropped
            rank = _rank(weighted, may)
            first = may & (rank == _largest_around(rank))
            dropped |= first
            lacking = np.where(part, lacking - _spread(first, ink), 0.0)


class ErrorDiffusion:
    """Error diffusion of what is lacking, in layers: each cell's rounding is made good by its neighbours."""

    def __init__(self, job: Job, *, region_test: Annotated[RegionTest, Option()] = "middle") -> None:
        self._job = job
        self._problems = one_layer(job, DropletChoices(job, region_test=region_test), alpha=1.0)

    def plan(self, estimate: Estimate, layer: int, last: IntPlan, elapsed: float = 0.0) -> LayerPlan:
        """Droplets as dense as the share of a layer that is lacking; DONE if that is none."""
        job, problem = self._job, self._problems.problem(estimate, layer)
        h1, h2, h3 = ink_maps(estimate.inks, self._problems.materials(estimate.height))
        lacking = (job.target_height - estimate.height) / (h1 + 4.0 * h2 + 4.0 * h3)
        pattern = diffuse(problem, np.where(problem.choices > 0, lacking, 0.0))[0]
        return judged(job, estimate, layer, pattern, "error diffusion")


def _gathered(field: FloatMap, ink: tuple[FloatMap, FloatMap, FloatMap]) -> FloatMap:
    """The field around each cell, times the footprint of a droplet there; nothing beyond the grid."""
    nx, ny = field.shape
    padded = np.pad(field, 1)
    gathered = ink[0] * field
    for i, j in np.ndindex(3, 3):
        if (i, j) != (1, 1):
            gathered += ink[abs(i - 1) + abs(j - 1)] * padded[i : i + nx, j : j + ny]
    return np.asarray(gathered, np.float64)


def _spread(dropped: BoolMap, ink: tuple[FloatMap, FloatMap, FloatMap]) -> FloatMap:
    """Height that droplets add on flat ground [m]."""
    nx, ny = dropped.shape
    grown = np.zeros((nx + 2, ny + 2))
    for i, j in np.ndindex(3, 3):
        grown[i : i + nx, j : j + ny] += np.where(dropped, ink[abs(i - 1) + abs(j - 1)], 0.0)
    return grown[1:-1, 1:-1]


def _rank(values: FloatMap, may: BoolMap) -> IntMap:
    """Place of each cell in the order of values, the first of equal ones highest, 0 where it may not be chosen."""
    order = np.argsort(-values, axis=None, kind="stable")
    rank = np.empty(values.size, np.int32)
    rank[order] = np.arange(values.size, 0, -1)
    return np.where(may, rank.reshape(values.shape), 0).astype(np.int32)


def _largest_around(rank: IntMap) -> IntMap:
    """The largest one within reach of each cell."""
    for axis in (0, 1):
        padded = np.pad(rank, [(REACH, REACH) if axis == k else (0, 0) for k in (0, 1)])
        size, width = rank.shape[axis], 2 * REACH + 1
        rank = np.max([np.take(padded, np.arange(size) + k, axis=axis) for k in range(width)], axis=0)
    return rank
