"""The controllers that a scenario can name, each with its options as a scenario writes them."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Annotated, TypeVar

from pydantic import Field

from inkloop.component import Job
from inkloop.units import M_PER_UM
from inkloop_controller.baselines.geometric_feedback import CohenLipson, ErrorDiffusion
from inkloop_controller.baselines.planners import OpenLoop, StochasticGreedy
from inkloop_controller.estimation.height_estimator import HeightEstimator
from inkloop_controller.estimation.ink_identification import InkModel
from inkloop_controller.layer_controller import LayerController
from inkloop_controller.model.droplet_choices import DropletChoices
from inkloop_controller.model.regions import RegionTest
from inkloop_controller.planning.layer_mpc import LayerMpc, Relaxation
from inkloop_controller.problem.criterion import Criterion
from inkloop_controller.problem.work import Work

T = TypeVar("T")
NotNegative = Annotated[float, Field(ge=0.0)]
Length = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0.0)]
Count = Annotated[int, Field(ge=1)]
"""Limits that are told with the key and the number of the scenario, not with those in SI further inside."""


def LayerMpcController(
    job: Job,
    *,
    alpha: float | list[tuple[int, float]] = 0.8,
    horizon: int = 3,
    overshoot: float = 1.0,
    overshoot_limit_um: NotNegative | None = None,
    chance_margin: float = 0.0,
    fringe_weight: float = 0.0,
    layer_worth: float = 0.0,
    region_test: RegionTest = "middle",
    drop_levels: int = 1,
    dead_nozzles: list[int] | None = None,
    nozzle_pitch: int = 0,
    relaxation: Relaxation = "gradient",
    iterations: int = 10,
    sweeps: int = 30,
    annealing_sweeps: int | None = None,
    threads: int = 1,
    time_limit_s: Positive | None = None,
    certified: bool = False,
    adapt_ink: InkModel = "scale",
    sensor_noise_std_um: Length | None = None,
    sensor_resolution_um: Length = 0.0,
    untrusted_layers: int = 5,
) -> LayerController:
    """The controller of this project; see LayerMpc, Criterion, DropletChoices, Work and HeightEstimator.

    Raises ValueError with the faults of all of them.
    """
    faults: list[str] = []
    criterion = _tried(
        faults,
        lambda: Criterion(
            alpha=alpha,
            overshoot=overshoot,
            overshoot_limit=inf if overshoot_limit_um is None else overshoot_limit_um * M_PER_UM,
            chance_margin=chance_margin,
            fringe_weight=fringe_weight,
            layer_worth=layer_worth,
        ),
    )
    choices = _tried(
        faults,
        lambda: DropletChoices(
            job,
            region_test=region_test,
            drop_levels=drop_levels,
            dead_nozzles=dead_nozzles or (),
            nozzle_pitch=nozzle_pitch,
        ),
    )
    limit = inf if time_limit_s is None else time_limit_s
    work = _tried(faults, lambda: Work(sweeps, annealing_sweeps, iterations, threads, limit))
    planner = _tried(
        faults,
        lambda: LayerMpc(
            job,
            criterion=criterion or Criterion(alpha=1.0),  # of which no certificate complains
            horizon=horizon,
            choices=choices,
            relaxation=relaxation,
            work=work or Work(),
            certified=certified,
        ),
    )
    estimator = _tried(
        faults,
        lambda: HeightEstimator(
            job,
            adapt_ink=adapt_ink,
            sensor_noise_std=None if sensor_noise_std_um is None else sensor_noise_std_um * M_PER_UM,
            sensor_resolution=sensor_resolution_um * M_PER_UM,
            untrusted_layers=untrusted_layers,
        ),
    )
    if faults or planner is None or estimator is None:
        raise ValueError("; ".join(faults))
    return LayerController(job, planner, estimator)


def OpenLoopController(job: Job, *, layers: int | None = None) -> LayerController:
    """Full layers, blindly; see OpenLoop."""
    return LayerController(job, OpenLoop(job, layers=layers), HeightEstimator(job, adapt_ink="off", take_as_read=True))


def StochasticGreedyController(
    job: Job, *, alpha: float = 0.8, batch: Count = 20, iterations_max: Count = 100_000
) -> LayerController:
    """The paper's controller; see StochasticGreedy. The paper takes ink and scans as they are."""
    planner = StochasticGreedy(job, alpha=alpha, batch=batch, iterations_max=iterations_max)
    return LayerController(job, planner, HeightEstimator(job, adapt_ink="off", take_as_read=True))


def CohenLipsonController(
    job: Job, *, threshold_um: Length | None = None, region_test: RegionTest = "middle"
) -> LayerController:
    """Greedy geometric feedback; see CohenLipson. Scans are taken as they are."""
    threshold = None if threshold_um is None else threshold_um * M_PER_UM
    planner = CohenLipson(job, threshold=threshold, region_test=region_test)
    return LayerController(job, planner, HeightEstimator(job, adapt_ink="off", take_as_read=True))


def ErrorDiffusionController(job: Job, *, region_test: RegionTest = "middle") -> LayerController:
    """Error diffusion of what each layer lacks; see ErrorDiffusion. Scans are taken as they are."""
    planner = ErrorDiffusion(job, region_test=region_test)
    return LayerController(job, planner, HeightEstimator(job, adapt_ink="off", take_as_read=True))


def _tried(faults: list[str], make: Callable[[], T]) -> T | None:
    """What `make` makes, or None and its fault in the list: the others are looked at all the same."""
    try:
        return make()
    except ValueError as error:
        faults.append(str(error))
        return None
