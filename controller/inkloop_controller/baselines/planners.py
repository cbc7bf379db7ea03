"""Baseline planners: open loop, and the search of the paper."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np

from inkloop.component import Job
from inkloop_controller.core import bindings
from inkloop_controller.estimation.height_estimator import Estimate
from inkloop_controller.model.droplet_choices import DropletChoices
from inkloop_controller.model.layer_model import LayerModel
from inkloop_controller.model.layer_problems import LayerProblems
from inkloop_controller.model.starts import full_layers, no_droplets
from inkloop_controller.planning.layer_plan import LayerPlan, PlanStatus, surface_objective
from inkloop_controller.problem.criterion import Criterion
from inkloop_controller.problem.horizon_problem import IntMap, IntPlan
from inkloop_controller.problem.options import Count, Option


class OpenLoop:
    """Layers until the nominal height of each cell is reached; measured heights change nothing.

    layers: how many on every cell; None: its target height / height of a full layer, rounded. A cell's ink is chosen
    at the middle of the layer's nominal position. Its objective is the mean error. Raises ValueError for layers < 0.
    """

    def __init__(self, job: Job, *, layers: Annotated[int | None, Option()] = None) -> None:
        if layers is not None and layers < 0:
            raise ValueError(f"layers is {layers}; needs a whole number >= 0")
        nominal = np.round(job.target_height / nominal_layer_height(job))
        self._job, self._problems = job, one_layer(job, DropletChoices(job), alpha=1.0)
        self._layers = np.where(job.mask, nominal if layers is None else layers, 0)

    def plan(self, estimate: Estimate, layer: int, last: IntPlan, elapsed: float = 0.0) -> LayerPlan:
        """A droplet on every cell of the part that is to be higher, DONE after the last layer."""
        lacking = layer < self._layers
        nominal_surface = np.full(lacking.shape, layer * nominal_layer_height(self._job))
        pattern = np.where(lacking, 1 + self._problems.materials(nominal_surface), 0).astype(np.int32)
        return judged(self._job, estimate, layer, pattern, "full layer")


class StochasticGreedy:
    """The stochastic greedy search of Lu, Zheng, Mishra (2015, IV-C), one layer ahead, as literally as it can be run.

    It starts from a droplet everywhere and takes a cell's ink from the measured surface itself. Two things that the
    paper leaves open: a batch that raises the objective is undone and batches are halved from then on, and the print
    ends when nothing is the better layer. batch: flips tried together, the paper's M (it gives no number: 20 assumed);
    iterations_max: batches per layer. Raises ValueError for invalid options.
    """

    def __init__(
        self,
        job: Job,
        *,
        alpha: Annotated[float, Option()] = 0.8,
        batch: Annotated[int, Option(form=Count)] = 20,
        iterations_max: Annotated[int, Option(form=Count)] = 100_000,
    ) -> None:
        if batch < 1 or iterations_max < 1:
            raise ValueError(f"batch is {batch} and iterations_max {iterations_max}; needs whole numbers >= 1")
        check_single_pass(job)
        self._model = LayerModel.of(job)
        self._problems = one_layer(job, DropletChoices(job, region_test="surface"), alpha)
        self._batch, self._iterations_max = batch, iterations_max
        self._seed = job.seed % 2**32 << 32

    def plan(self, estimate: Estimate, layer: int, last: IntPlan, elapsed: float = 0.0) -> LayerPlan:
        """The pattern that the search ends with; DONE if printing nothing is better."""
        problem, key = self._problems.problem(estimate, layer), self._seed + layer
        found = bindings.paper_search(problem, full_layers(problem), self._batch, self._iterations_max, key)
        idle = bindings.objective(problem, no_droplets(problem))
        if found.objective.value >= idle.value:
            return LayerPlan.of_pattern(no_droplets(problem)[0], idle, estimate.height, PlanStatus.DONE, "nothing")
        predicted = replace(self._model, inks=estimate.inks).layer(estimate.height, found.plan[0], layer + 1)
        status = PlanStatus.REPAIRED if found.is_done else PlanStatus.BUDGET
        sweeps = found.progress.sweeps
        return LayerPlan.of_pattern(found.plan[0], found.objective, predicted, status, "full layer", sweeps)


def one_layer(job: Job, choices: DropletChoices, alpha: float) -> LayerProblems:
    """Problems of the next layer alone, by the mean error and the deviation of the predicted surface."""
    plain = Criterion(alpha=alpha, overshoot=1.0, droplet_std=0.0)
    return LayerProblems(job, plain, choices, horizon=1)


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
