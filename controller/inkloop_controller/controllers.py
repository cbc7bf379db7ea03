"""The controllers that a scenario can name; their options are keyword arguments marked with `Option`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, TypeVar

from inkloop.component import Job
from inkloop_controller.baselines.geometric_feedback import CohenLipson, ErrorDiffusion
from inkloop_controller.baselines.planners import OpenLoop, StochasticGreedy
from inkloop_controller.estimation.height_estimator import HeightEstimator
from inkloop_controller.layer_controller import LayerController, OnDoubt
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
    criterion = _tried(errors, lambda: Criterion(**arguments(Criterion, options)))
    choices = _tried(errors, lambda: DropletChoices(job, **arguments(DropletChoices, options)))
    work = _tried(errors, lambda: Work(**arguments(Work, options)))
    planner = _tried(
        errors,
        lambda: LayerMpc(
            job,
            criterion=criterion or Criterion(alpha=1.0),  # of which no certificate complains
            choices=choices,
            work=work or Work(),
            **arguments(LayerMpc, options),
        ),
    )
    levels = arguments(DropletChoices, options).get("drop_levels", 1)
    threads = (work or Work()).threads
    estimator = _tried(
        errors,
        lambda: HeightEstimator(job, drop_levels=levels, threads=threads, **arguments(HeightEstimator, options)),
    )
    if errors or planner is None or estimator is None:
        raise ValueError("; ".join(errors))
    return LayerController(job, planner, estimator, on_doubt_option(**arguments(on_doubt_option, options)))


@made_of(OpenLoop)
def OpenLoopController(job: Job, **options: object) -> LayerController:
    """Full layers, blindly; see OpenLoop."""
    return _of_planner(job, OpenLoop(job, **arguments(OpenLoop, options)))


@made_of(StochasticGreedy)
def StochasticGreedyController(job: Job, **options: object) -> LayerController:
    """The paper's controller; see StochasticGreedy. The paper takes ink and scans as they are."""
    return _of_planner(job, StochasticGreedy(job, **arguments(StochasticGreedy, options)))


@made_of(CohenLipson)
def CohenLipsonController(job: Job, **options: object) -> LayerController:
    """Greedy geometric feedback; see CohenLipson. Scans are taken as they are."""
    return _of_planner(job, CohenLipson(job, **arguments(CohenLipson, options)))


@made_of(ErrorDiffusion)
def ErrorDiffusionController(job: Job, **options: object) -> LayerController:
    """Error diffusion of what each layer lacks; see ErrorDiffusion. Scans are taken as they are."""
    return _of_planner(job, ErrorDiffusion(job, **arguments(ErrorDiffusion, options)))


def _of_planner(job: Job, planner: Planner) -> LayerController:
    """A planner that takes ink and scans as they are."""
    return LayerController(job, planner, HeightEstimator(job, adapt_ink="off", take_as_read=True))


def _tried(errors: list[str], make: Callable[[], T]) -> T | None:
    """The result of `make`, or None with its error appended, so that all errors are reported together."""
    try:
        return make()
    except ValueError as error:
        errors.append(str(error))
        return None
