"""Droplets of another kind than the model's, read by exact sensors: the estimate follows the scan."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from inkloop.component import Ink, Job
from inkloop_controller.estimation.height_estimator import HeightEstimator
from inkloop_controller.model.layer_model import LayerModel
from inkloop_lab.models.volume_area_deposition import VolumeAreaDeposition

TOLERANCE = 0.01e-6  # [m]
SIDE, RADIUS = 25, 10
ROW, COLUMN = np.indices((SIDE, SIDE))
PART = (ROW - 12) ** 2 + (COLUMN - 12) ** 2 <= RADIUS**2
JOB = Job(SIDE, SIDE, 90e-6, np.where(PART, 70e-6, 0.0), PART)
SEEN = np.ones(PART.shape, np.bool_)
PLAIN = {"register_scans": False}

Step = Callable[[Any, np.random.Generator], Any]
"""The surface after a layer of this pattern."""


def wu_chiu() -> Step:
    plant = VolumeAreaDeposition(guard=True, limit_gains=True)
    surface = plant.start(np.zeros(PART.shape))
    layer = 0

    def step(pattern: Any, rng: np.random.Generator) -> Any:
        nonlocal surface, layer
        layer += 1
        surface = plant.layer(surface, pattern, layer, 1.0 - 0.2 * rng.random(PART.shape))
        return surface.height

    return step


def other_ink(ink: Ink) -> Step:
    plant, height, layer = LayerModel((ink,)), np.zeros(PART.shape), 0

    def step(pattern: Any, rng: np.random.Generator) -> Any:
        nonlocal height, layer
        layer += 1
        height = plant.layer(height, pattern, layer, 1.0 - 0.2 * rng.random(PART.shape))
        return height

    return step


PLANTS: dict[str, Callable[[], Step]] = {
    "Wu and Chiu": wu_chiu,
    "wide spill": lambda: other_ink(Ink(3.2e-6, 0.9e-6, 0.2e-6)),
    "no spill": lambda: other_ink(Ink(6.0e-6, 0.4e-6, 0.0)),
}


def errors(step: Step, layers: int, seed: int, **options: Any) -> list[float]:
    """Largest error of the estimate after each layer [m]; a droplet falls where one is missing."""
    estimator, rng, height = HeightEstimator(JOB, **options), np.random.default_rng(seed), np.zeros(PART.shape)
    estimate, found = estimator.first(height, SEEN), []
    for layer in range(1, layers + 1):
        missing = PART & (estimate.height < JOB.target_height - 3e-6)
        pattern = (missing if missing.any() else PART & (rng.random(PART.shape) < 0.1)).astype(np.int32)
        height = step(pattern, rng)
        estimate = estimator.next(estimate, pattern, layer, height, SEEN)
        found.append(float(np.abs(estimate.height - height).max()))
    return found


FULL = 6  # layers in which a droplet is missing everywhere


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("name", PLANTS)
@pytest.mark.parametrize("options", [{}, PLAIN], ids=["registered", "in register"])
def test_estimate_follows_exact_scans_of_full_layers_of_a_foreign_plant(
    options: dict[str, Any], name: str, seed: int
) -> None:
    """The first full layer of droplets that spill wider looks like that of others under a spot."""
    first, *others = errors(PLANTS[name](), FULL, seed, **options)
    assert first < (1e-6 if name == "wide spill" and not options else TOLERANCE)
    assert max(others) < TOLERANCE
