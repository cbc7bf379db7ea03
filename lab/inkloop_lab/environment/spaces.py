"""Spaces of Gymnasium for the observations and actions of a policy."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box, Dict, MultiBinary, MultiDiscrete

from inkloop.contract import MEASURED_HEIGHT, VALID
from inkloop_lab.policies.policy import MASK, TARGET, ActionCode

HEIGHT_MAX_M = 1.0
"""Bound of heights, above any print (assumed)."""


def observation_space(shape: tuple[int, int]) -> Any:
    """Of a grid of `shape` cells."""
    heights, marks = Box(-HEIGHT_MAX_M, HEIGHT_MAX_M, shape, np.float64), MultiBinary(shape)
    return Dict({MEASURED_HEIGHT: heights, VALID: marks, TARGET: heights, MASK: marks})


def action_space(code: ActionCode) -> MultiBinary | MultiDiscrete[Any]:
    """A bit for each cell if the only choice is a droplet or none."""
    return MultiBinary(code.shape) if code.values == 2 else MultiDiscrete(np.full(code.shape, code.values))
