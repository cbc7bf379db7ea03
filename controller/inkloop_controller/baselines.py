"""What the controller is compared with: printing blindly, and the search of the paper."""

from __future__ import annotations

import numpy as np

from inkloop.component import FloatMap, Job
from inkloop_controller import one_layer as core
from inkloop_controller.core import IntMap
from inkloop_controller.layer_model import LayerModel
from inkloop_controller.layer_mpc import check_alpha, check_single_pass, layer_problem, random_key
from inkloop_controller.layer_plan import LayerPlan, PlanStatus, layer_objective
from inkloop_controller.regions import materials, nominal_layer_height


class OpenLoop:
    """Layers until the nominal height of each cell is reached; measured heights change nothing.

    layers: how many on every cell; None: its target height / height of a full layer, rounded. A cell's ink is chosen
    at the middle of the layer's nominal position. Its objective is the mean error. Raises ValueError for layers < 0.
    """

    def __init__(self, job: Job, *, layers: int | None = None) -> None:
        if layers is not None and layers < 0:
            raise ValueError(f"layers is {layers}; needs a whole number >= 0")
        nominal = np.round(job.target_height / nominal_layer_height(job))
        self._job, self._model = job, LayerModel.of(job)
        self._layers = np.where(job.mask, nominal if layers is None else layers, 0)

    def plan(self, height: FloatMap, ink_scale: float, layer: int, last: IntMap) -> LayerPlan:
        """A droplet on every cell of the part that is to be higher, DONE after the last layer."""
        job = self._job
        lacking = layer < self._layers
        if not lacking.any():
            objective = layer_objective(height, job.target_height, job.mask, 1.0)
            return LayerPlan(np.zeros_like(last), objective, height, PlanStatus.DONE, "nothing")
        nominal_surface = np.full(height.shape, layer * nominal_layer_height(job))
        pattern = np.where(lacking, 1 + materials(job, nominal_surface, "middle"), 0).astype(np.int32)
        predicted = self._model.scaled(ink_scale).layer(height, pattern, layer + 1)
        objective = layer_objective(predicted, job.target_height, job.mask, 1.0)
        return LayerPlan(pattern, objective, predicted, PlanStatus.FIXED, "everything")


class StochasticGreedy:
    """The stochastic greedy search of Lu, Zheng, Mishra (2015, IV-C), one layer ahead, as literally as it can be run.

    It starts from a droplet everywhere and takes a cell's ink from the measured surface itself. Two things that the
    paper leaves open: a batch that raises the objective is undone and batches are halved from then on, and the print
    ends when nothing is the better layer. batch: flips tried together, the paper's M (it gives no number: 20 assumed);
    iterations_max: batches per layer. Raises ValueError for options that cannot be meant.
    """

    def __init__(self, job: Job, *, alpha: float = 0.8, batch: int = 20, iterations_max: int = 100_000) -> None:
        if batch < 1 or iterations_max < 1:
            raise ValueError(f"batch is {batch} and iterations_max {iterations_max}; needs whole numbers >= 1")
        check_single_pass(job)
        check_alpha(alpha)
        self._job, self._model, self._alpha = job, LayerModel.of(job), alpha
        self._batch, self._iterations_max = batch, iterations_max

    def plan(self, height: FloatMap, ink_scale: float, layer: int, last: IntMap) -> LayerPlan:
        """The pattern that the search ends with; DONE if printing nothing is better."""
        job = self._job
        problem = layer_problem(job, height, ink_scale, self._alpha, "surface")
        nothing, everything = np.zeros_like(last), job.mask.astype(np.int32)
        found = core.paper_search(problem, everything, self._batch, self._iterations_max, random_key(job, layer))
        idle = core.objective(problem, nothing)
        if found.objective >= idle:
            return LayerPlan(nothing, idle, height, PlanStatus.DONE, "nothing", found.sweeps)
        predicted = self._model.scaled(ink_scale).layer(height, found.pattern, layer + 1)
        status = PlanStatus.REPAIRED if found.finished else PlanStatus.BUDGET
        return LayerPlan(found.pattern, found.objective, predicted, status, "everything", found.sweeps)
