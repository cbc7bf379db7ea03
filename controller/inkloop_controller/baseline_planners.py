"""Planners to compare with: open loop, the search of the paper, and two that use the present height deficit alone."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np

from inkloop.component import BoolMap, FloatMap, Job
from inkloop_controller.core import bindings
from inkloop_controller.core.bindings import diffuse
from inkloop_controller.estimation.height_estimator import Estimate
from inkloop_controller.model import DropletChoices, LayerModel, LayerProblems, RegionTest, ink_maps
from inkloop_controller.planning.layer_plan import LayerPlan, PlanStatus, surface_objective
from inkloop_controller.problem.criterion import Criterion
from inkloop_controller.problem.horizon_problem import IntMap, IntPlan, full_layers, no_droplets
from inkloop_controller.problem.options import Count, Length, Option, declared, errors_of, refuse


class OpenLoop:
    """Layers until the nominal height of each cell is reached; measured heights change nothing.

    layers: how many on every cell; None: its target height / height of a full layer, rounded. A cell's ink is chosen
    at the middle of the layer's nominal position. Its objective is the mean error. Raises ValueError for layers < 0.
    """

    def __init__(self, job: Job, *, layers: Annotated[int | None, Option()] = None) -> None:
        if layers is not None and layers < 0:
            raise ValueError(f"layers is {layers}; needs a whole number >= 0")
        nominal = np.round(job.target_height / nominal_layer_height(job))
        self._job, self._problems = job, plain_problems(job, DropletChoices(job), alpha=1.0)
        self._layers = np.where(job.mask, nominal if layers is None else layers, 0)

    def plan(self, estimate: Estimate, layer: int, last: IntPlan, elapsed: float = 0.0) -> LayerPlan:
        """A droplet on every cell of the part that is to be higher, DONE after the last layer."""
        lacking = layer < self._layers
        nominal_surface = np.full(lacking.shape, layer * nominal_layer_height(self._job))
        pattern = np.where(lacking, 1 + self._problems.materials(nominal_surface), 0).astype(np.int32)
        return judged(self._job, estimate, layer, pattern, "full layer")


class StochasticGreedy:
    """The stochastic greedy search of Lu, Zheng, Mishra (2015, IV-C), as literally as it can be run.

    It starts from a droplet everywhere and takes a cell's ink from the measured surface itself. Two things that the
    paper leaves open: a batch that raises the objective is undone and batches are halved from then on, and the print
    ends when nothing is the better plan. batch: flips tried together, the paper's M (it gives no number: 20 assumed);
    iterations_max: batches per layer; horizon: layers ahead, 1 in the paper. Raises ValueError for invalid options.
    """

    def __init__(
        self,
        job: Job,
        *,
        alpha: Annotated[float, Option()] = 0.8,
        batch: Annotated[int, Option(form=Count)] = 20,
        iterations_max: Annotated[int, Option(form=Count)] = 100_000,
        horizon: Annotated[int, declared("horizon")] = 1,
    ) -> None:
        if batch < 1 or iterations_max < 1:
            raise ValueError(f"batch is {batch} and iterations_max {iterations_max}; needs whole numbers >= 1")
        refuse(errors_of(horizon=horizon))
        check_single_pass(job)
        self._model = LayerModel.of(job)
        self._problems = plain_problems(job, DropletChoices(job, region_test="surface"), alpha, horizon)
        self._batch, self._iterations_max = batch, iterations_max
        self._seed = job.seed % 2**32 << 32

    def plan(self, estimate: Estimate, layer: int, last: IntPlan, elapsed: float = 0.0) -> LayerPlan:
        """The first layer of the plan that has a droplet; DONE if printing nothing is better."""
        problem, key = self._problems.problem(estimate, layer), self._seed + layer
        found = bindings.paper_search(problem, full_layers(problem), self._batch, self._iterations_max, key)
        idle = bindings.objective(problem, no_droplets(problem))
        if not found.plan.any() or found.objective.value >= idle.value:
            return LayerPlan.of_pattern(no_droplets(problem)[0], idle, estimate.height, PlanStatus.DONE, "nothing")
        pattern = next(each for each in found.plan if each.any())
        predicted = replace(self._model, inks=estimate.inks).layer(estimate.height, pattern, layer + 1)
        status = PlanStatus.REPAIRED if found.is_done else PlanStatus.BUDGET
        return LayerPlan.of_pattern(pattern, found.objective, predicted, status, "full layer", found.progress.sweeps)


def plain_problems(job: Job, choices: DropletChoices, alpha: float, horizon: int = 1) -> LayerProblems:
    """Problems of so many layers ahead, by the mean error and the deviation of the predicted surface."""
    plain = Criterion(alpha=alpha, overshoot=1.0, droplet_std=0.0)
    return LayerProblems(job, plain, choices, horizon=horizon)


def nominal_layer_height(job: Job) -> float:
    """Height of a full layer [m]; where the job has a region, the mean over its inks."""
    inks = job.inks if job.region is not None else job.inks[:1]
    return sum(ink.layer_height for ink in inks) / len(inks)


def judged(job: Job, estimate: Estimate, layer: int, pattern: IntMap, start: str) -> LayerPlan:
    """A pattern that was chosen without an objective, as a plan; the mean error that it leaves is what it is worth."""
    status = PlanStatus.FIXED if pattern.any() else PlanStatus.DONE
    predicted = replace(LayerModel.of(job), inks=estimate.inks).layer(estimate.height, pattern, layer + 1)
    objective = surface_objective(predicted, job.target_height, job.mask, 1.0)
    return LayerPlan.of_pattern(pattern, objective, predicted, status, start)


def check_single_pass(job: Job) -> None:
    """Raises ValueError for a job of several passes: over them the surface is not linear in the pattern."""
    if job.passes != 1:
        raise ValueError(f"passes is {job.passes}; this controller plans layers of 1 pass (LayerMpc takes 4)")


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
        self._problems = plain_problems(job, DropletChoices(job, region_test=region_test), alpha=1.0)

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
        self._problems = plain_problems(job, DropletChoices(job, region_test=region_test), alpha=1.0)

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
