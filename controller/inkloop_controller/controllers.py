"""The controllers that a scenario can name, whose options are keyword arguments marked with `Option`; and a controller
from one function: surface in, pattern of the next layer out.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from inkloop.component import FloatMap, Job
from inkloop.errors import ComponentError
from inkloop_controller.baseline_planners import CohenLipson, ErrorDiffusion, OpenLoop, StochasticGreedy, judged
from inkloop_controller.estimation.height_estimator import Estimate, HeightEstimator
from inkloop_controller.layer_controller import LayerController, OnDoubt, controller_as_read
from inkloop_controller.model import DropletChoices
from inkloop_controller.planning.layer_mpc import LayerMpc
from inkloop_controller.planning.layer_plan import LayerPlan, Planner
from inkloop_controller.problem.criterion import Criterion, Work
from inkloop_controller.problem.horizon_problem import IntMap, IntPlan
from inkloop_controller.problem.options import arguments, declared, default, made_of

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
    estimator = made(HeightEstimator, job, drop_levels=levels, threads=work.cores)
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


class PatternRule(Protocol):
    """The interface that a class needs to control the print."""

    def pattern(self, height: FloatMap, layer: int) -> ArrayLike:
        """The pattern (nx, ny) for the surface `height` (nx, ny) [m] after `layer` layers.

        0 or False: nothing; 1 or True: material A; 2: material B. No droplet at all ends the print. Cells that the
        sensor did not see have the height that the layer model predicts. What the rule remembers of earlier layers is
        not saved: a resumed run begins with a new rule.
        """


class RulePlanner:
    """A rule as a planner. Its objective is the mean error over the part that the layer model predicts [m]."""

    def __init__(self, job: Job, rule: PatternRule) -> None:
        self._job, self._rule = job, rule

    def plan(self, estimate: Estimate, layer: int, last: IntPlan, elapsed: float = 0.0) -> LayerPlan:
        """The pattern of the rule, DONE for None. Raises ComponentError for an invalid pattern."""
        pattern = self._checked(np.asarray(self._rule.pattern(estimate.height.copy(), layer)), layer)
        return judged(self._job, estimate, layer, pattern, "rule")

    def _checked(self, pattern: np.ndarray, layer: int) -> IntMap:
        shape, inks = (self._job.nx, self._job.ny), len(self._job.inks)
        place = f"the pattern for layer {layer + 1}"
        if pattern.shape != shape:
            raise ComponentError(f"{place} has shape {pattern.shape}; needs {shape}")
        if pattern.dtype.kind not in "bui":
            raise ComponentError(f"{place} is {pattern.dtype}; needs whole numbers or booleans")
        wrong = np.argwhere((pattern < 0) | (pattern > inks))
        if wrong.size:
            i, j = (int(index) for index in wrong[0])
            raise ComponentError(
                f"{place} is {pattern[i, j]} in cell ({i}, {j}); needs 0 .. {inks}, the number of inks"
            )
        return pattern.astype(np.int32)


def rule_controller(job: Job, rule: PatternRule) -> LayerController:
    """The layer controller that goes by `rule`; it takes the nominal ink as known."""
    return controller_as_read(job, RulePlanner(job, rule))
