"""The layer problems that controllers are measured on, each made from a seed."""

from __future__ import annotations

import numpy as np

from inkloop.component import FloatMap, Ink
from inkloop_controller.core import bindings
from inkloop_controller.problem.horizon_problem import HorizonProblem

INK = Ink()
SHARE = 0.6  # of a full layer, wanted on average of each layer of the horizon
LAYERS_BELOW = 20
VARIATION = 0.2


def problem(height: FloatMap, target: FloatMap, layers: int, alpha: float = 1.0) -> HorizonProblem:
    """A problem in one ink over all cells of a grid."""
    everywhere = np.ones(height.shape, np.bool_)
    return HorizonProblem(height, target, everywhere, np.ones((layers, *height.shape), np.uint16), (INK,), alpha)


def nearly_flat(side: int, layers: int, seed: int = 0, alpha: float = 1.0) -> HorizonProblem:
    """A printed surface: 20 full layers of varying droplets, then 0.6 of a layer wanted for each layer to come."""
    rng = np.random.default_rng(seed)
    height, full = np.zeros((side, side)), np.ones((side, side), np.int32)
    for _ in range(LAYERS_BELOW):
        height = bindings.layer(height, full, (INK,), factor=1.0 - VARIATION * rng.random(height.shape))
    return problem(height, np.full_like(height, height.mean() + SHARE * layers * INK.layer_height), layers, alpha)


def rough(shape: tuple[int, int], layers: int = 1, seed: int = 0, alpha: float = 1.0) -> HorizonProblem:
    """A random surface of 0 to 8 um, half a layer wanted for each layer to come: no plan reaches it."""
    height = np.random.default_rng(seed).uniform(0.0, 8e-6, shape)
    return problem(height, np.full(shape, height.mean() + layers * INK.layer_height / 2), layers, alpha)


def recoverable(side: int, layers: int, seed: int, rise: float) -> HorizonProblem:
    """A random surface of 0 to `rise` [m], and as target the surface after a random plan."""
    rng = np.random.default_rng(seed)
    height = rng.uniform(0.0, rise, (side, side))
    target = height
    for pattern in rng.integers(0, 2, (layers, side, side), dtype=np.int32):
        target = bindings.layer(target, pattern, (INK,))
    return problem(height, target, layers)
