"""The decision problems of a job: of the layers that follow a scan, and the work that their plan may take."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from inkloop.component import FloatMap, Ink, Job
from inkloop.geometry import Columns
from inkloop_controller.core.bindings import checked, laid_out, pointer
from inkloop_controller.core.layer_step import LayerStep
from inkloop_controller.core.library import library
from inkloop_controller.core.structs import PlanWorkStruct, ProblemMapsStruct, ProblemStruct, SurfaceToPlanStruct
from inkloop_controller.estimation.height_estimator import Estimate
from inkloop_controller.model.droplet_choices import DropletChoices
from inkloop_controller.problem.criterion import Criterion
from inkloop_controller.problem.horizon_problem import ChoiceMaps, HorizonProblem, IntMap

_INK_B = 2  # choices where ink B alone may fall, in single drops


class LayerProblems:
    """Problems as controller/core/step/step_problem.h builds them.

    ahead: the most layers that are planned ahead; options: further values by the names of variables.toml.
    """

    def __init__(
        self,
        job: Job,
        criterion: Criterion,
        choices: DropletChoices,
        *,
        ahead: int,
        threads: int = 1,
        **options: Any,
    ) -> None:
        self._job, self._criterion, self._ahead = job, criterion, ahead
        columns = None if job.region is None else Columns.of_shape(job.region, job.nx, job.ny, job.pitch)
        self._step = LayerStep(
            job,
            jettable=choices.jettable,
            columns=columns,
            threads=threads,
            region_test=choices.region_test,
            drop_levels=choices.drop_levels,
            overshoot=criterion.overshoot,
            overshoot_limit=criterion.overshoot_limit,
            chance_margin=criterion.chance_margin,
            fringe_weight=criterion.fringe_weight,
            droplet_std=criterion.droplet_std,
            layer_worth=criterion.layer_worth,
            **options,
        )

    def materials(self, height: FloatMap) -> IntMap:
        """(nx, ny) index of the ink that belongs on each cell of the part, on a surface `height` [m]: 0 A, 1 B."""
        *_, choices = self._filled(Estimate.exact(height, self._job.inks), 0)
        return np.asarray(choices[0] == _INK_B, np.int32)

    def problem(self, estimate: Estimate, layer: int) -> HorizonProblem:
        """The problem of the layers that follow layer number `layer`. Raises ValueError for what cannot be one."""
        found, ceiling, weight, choices = self._filled(estimate, layer)
        return HorizonProblem(
            height=estimate.height,
            target=self._job.target_height,
            part=self._job.mask,
            choices=choices,
            kinds=tuple(Ink(kind.h1, kind.h2, kind.h3) for kind in found.kind[: found.kinds]),
            alpha=found.alpha,
            weight=weight if found.weight else None,
            overshoot=found.overshoot,
            ceiling=ceiling if found.ceiling else None,
            ceiling_cost=found.ceiling_cost,
            droplet_std=found.droplet_std,
            colours=tuple(tuple(order) for order in found.colours[: found.layers]) if found.passes > 1 else (),
        )

    def _filled(self, estimate: Estimate, layer: int) -> tuple[ProblemStruct, FloatMap, FloatMap, ChoiceMaps]:
        """The problem of C, and its maps of ceiling, weight and choices; what it does not need is not filled."""
        shape = self._step.shape
        height = checked("height", estimate.height, "f8", shape)
        variance = laid_out("height_variance", estimate.height_variance, "f8", shape)
        dead, capped = (laid_out("marks", marks, "?", shape) for marks in (estimate.dead, estimate.capped))
        self._step.set("alpha", self._criterion.alpha_of(layer + 1))
        figures = estimate.figures.struct(estimate.inks)
        ceiling, weight = np.empty(shape), np.empty(shape)
        choices = np.empty((self._ahead, *shape), np.uint16)
        surface = SurfaceToPlanStruct(
            pointer(height), pointer(variance), pointer(dead), pointer(capped), ctypes.addressof(figures)
        )
        found = ProblemStruct()
        room = ProblemMapsStruct(pointer(ceiling), pointer(weight), pointer(choices))
        library().inkloop_layer_problem(self._step.struct, surface, layer, room, found)
        return found, ceiling, weight, choices[: found.layers]

    def work(self, layer: int) -> PlanWorkStruct:
        """The work that the plan after layer number `layer` may take."""
        work = PlanWorkStruct()
        library().inkloop_plan_work(self._step.struct, layer, work)
        return work
