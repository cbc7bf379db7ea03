"""Layer problems: rough, nearly flat, and with all that a problem may have."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from inkloop.component import Ink
from inkloop_controller.core import bindings
from inkloop_controller.problem.horizon_problem import HorizonProblem, IntPlan

INKS = (Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6))
ORDERS = ((0, 3, 1, 2), (1, 2, 0, 3), (3, 0, 2, 1))


def rough(shape: tuple[int, int], layers: int = 1, seed: int = 0, **values: Any) -> HorizonProblem:
    """A rough surface with a flat target that takes half of all droplets."""
    height = np.random.default_rng(seed).uniform(0.0, 8e-6, shape)
    target = np.full(shape, height.mean() + 3.8e-6 * layers)
    choices = np.ones((layers, *shape), np.uint16)
    problem = HorizonProblem(height, target, np.ones(shape, np.bool_), choices, (Ink(),), 1.0)
    return replace(problem, **values)


def nearly_flat(shape: tuple[int, int], layers: int = 1, seed: int = 0, **values: Any) -> HorizonProblem:
    """Twenty full layers whose droplets lack up to 20 %, and a target 0.6 of a layer higher for each layer."""
    height = np.zeros(shape)
    for number in range(20):
        factor = 1.0 - 0.2 * np.random.default_rng([seed, number]).random(shape)
        height = bindings.layer(height, np.ones(shape, np.int32), (Ink(),), (), factor)
    target = np.full(shape, height.mean() + 0.6 * layers * Ink().layer_height)
    return rough(shape, layers, height=height, target=target, **values)


def with_everything(shape: tuple[int, int], layers: int, passes: int, seed: int, **values: Any) -> HorizonProblem:
    """Two inks, cells that may have either or none, a part with a fringe, a ceiling."""
    rng, plain = np.random.default_rng(seed), rough(shape, layers, seed)
    given: dict[str, Any] = {
        "part": rng.random(shape) < 0.8,
        "choices": rng.integers(0, 4, (layers, *shape), np.uint16),
        "kinds": INKS,
        "alpha": 0.3,
        "weight": rng.random(shape),
        "overshoot": 2.0,
        "ceiling": plain.target + 0.5e-6,
        "ceiling_cost": 3.0,
        "colours": ORDERS[:layers] if passes == 4 else (),
    }
    return replace(plain, **{**given, **values})


def random_plan(problem: HorizonProblem, seed: int) -> IntPlan:
    """On every cell nothing, or a droplet that is allowed there."""
    rng = np.random.default_rng(seed)
    kind = rng.integers(0, 1 + len(problem.kinds), problem.choices.shape)
    is_allowed = problem.choices >> np.maximum(kind - 1, 0) & 1 > 0
    return np.where(is_allowed, kind, 0).astype(np.int32)
