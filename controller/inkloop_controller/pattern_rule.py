"""A controller from one function: surface in, pattern of the next layer out; the handshake is built in."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from inkloop.component import FloatMap, Job
from inkloop.errors import ComponentError
from inkloop_controller.baselines.planners import judged
from inkloop_controller.estimation.height_estimator import Estimate
from inkloop_controller.layer_controller import LayerController, controller_as_read
from inkloop_controller.planning.layer_plan import LayerPlan
from inkloop_controller.problem.horizon_problem import IntMap, IntPlan


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
