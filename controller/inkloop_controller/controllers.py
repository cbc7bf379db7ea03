"""The controllers that a scenario can name; their options are keyword arguments marked with `Option`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, TypeVar

from inkloop.component import Job
from inkloop_controller.baselines.geometric_feedback import CohenLipson, ErrorDiffusion
from inkloop_controller.baselines.planners import OpenLoop, StochasticGreedy
from inkloop_controller.estimation.height_estimator import HeightEstimator
from inkloop_controller.layer_controller import LayerController, OnDoubt, controller_as_read
from inkloop_controller.model.droplet_choices import DropletChoices
from inkloop_controller.planning.layer_mpc import LayerMpc
from inkloop_controller.planning.layer_plan import Planner
from inkloop_controller.problem.criterion import Criterion
from inkloop_controller.problem.options import arguments, declared, default, made_of
from inkloop_controller.problem.work import Work

T = TypeVar("T")


def on_doubt_option(*, on_doubt: Annotated[OnDoubt, declared("on_doubt")] = default("on_doubt")) -> OnDoubt:
    """The option of LayerController itself."""
    return on_doubt


@made_of(LayerMpc, Criterion, DropletChoices, Work, HeightEstimator, on_doubt_option)
def LayerMpcController(job: Job, **options: object) -> LayerController:
    """The controller of this project; see LayerMpc, Criterion, DropletChoices, Work and HeightEstimator.

    Raises ValueError with the errors of all of them.
    """
    errors: list[str] = []

    def made(part: Callable[..., T], *given: object, **others: object) -> T | None:
        """The part with its options, or None with its error appended, so that all errors are reported together."""
        try:
            return part(*given, **others, **arguments(part, options))
        except ValueError as error:
            errors.append(str(error))
            return None

    criterion = made(Criterion) or Criterion(alpha=1.0)  # of which no certificate complains
    choices, work = made(DropletChoices, job), made(Work) or Work()
    planner = made(LayerMpc, job, criterion=criterion, choices=choices, work=work)
    levels = arguments(DropletChoices, options).get("drop_levels", 1)
    estimator = made(HeightEstimator, job, drop_levels=levels, threads=work.threads)
    if errors or planner is None or estimator is None:
        raise ValueError("; ".join(errors))
    return LayerController(job, planner, estimator, on_doubt_option(**arguments(on_doubt_option, options)))


def _of(planner: Callable[..., Planner]) -> Callable[..., LayerController]:
    """The controller around a planner that takes ink and scans as they are."""

    @made_of(planner)
    def controller(job: Job, **options: object) -> LayerController:
        return controller_as_read(job, planner(job, **arguments(planner, options)))

    return controller


OpenLoopController = _of(OpenLoop)
StochasticGreedyController = _of(StochasticGreedy)
CohenLipsonController = _of(CohenLipson)
ErrorDiffusionController = _of(ErrorDiffusion)
