"""What a planner is asked and what it answers."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from math import nan
from typing import Protocol

import numpy as np

from inkloop.component import BoolMap, FloatMap
from inkloop_controller.core import IntMap


class PlanStatus(StrEnum):
    """How a plan came about."""

    REPAIRED = "repaired"  # no flip and no swap improves it
    BUDGET = "budget"  # the work budget ended the repair
    FIXED = "fixed"  # the pattern was settled before the print
    DONE = "done"  # printing nothing is best: the print is finished


@dataclass(frozen=True)
class LayerPlan:
    """The pattern of the coming layer.

    pattern: (nx, ny), 0 none, 1 material A, 2 material B; objective of predicted_height [m]; start: the candidate that
    won; bound: no pattern can have a lower objective [m], if bound_valid.
    """

    pattern: IntMap
    objective: float
    predicted_height: FloatMap
    status: PlanStatus
    start: str
    sweeps: int = 0
    bound: float = nan
    bound_valid: bool = False


class Planner(Protocol):
    """Anything that decides on a layer."""

    def plan(self, height: FloatMap, ink_scale: float, layer: int, last: IntMap) -> LayerPlan:
        """The pattern for the surface `height` (nx, ny) [m] after `layer` layers, of which `last` was the last pattern.

        ink_scale: droplet volume as a share of the nominal one [1].
        """


def layer_objective(height: FloatMap, target: FloatMap, part: BoolMap, alpha: float) -> float:
    """alpha * mean |target - height| + (1 - alpha) * std(height) over the part [m] (Lu et al. 2015, eq. 8)."""
    error = float(np.abs(target - height)[part].mean())
    return alpha * error + (1.0 - alpha) * float(height[part].std())
