"""The estimated surface and the estimated ink."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from closed_loop import block
from inkloop.component import Job
from inkloop_controller.height_estimator import Estimate, HeightEstimator
from inkloop_controller.layer_model import LayerModel


def printed(job: Job, factor: float, layers: int, pattern: Any, adapt_ink: bool = True) -> Estimate:
    """The estimate after full layers of droplets with `factor` of the nominal volume, on average, scanned exactly."""
    estimator, plant, rng = HeightEstimator(job, adapt_ink=adapt_ink), LayerModel.of(job), np.random.default_rng(1)
    everywhere = np.ones((job.nx, job.ny), np.bool_)
    height = np.zeros((job.nx, job.ny))
    estimate = estimator.first(height, everywhere)
    for layer in range(1, layers + 1):
        volume = factor + 0.1 * (rng.random(height.shape) - 0.5)
        height = plant.layer(height, pattern, layer, volume)
        estimate = estimator.next(estimate, pattern, layer, height, everywhere)
    return estimate


@pytest.mark.parametrize("factor", [0.8, 0.9, 1.0, 1.2])
@pytest.mark.parametrize("passes", [1, 4])
def test_ink_scale_converges_to_the_mean_droplet_volume(factor: float, passes: int) -> None:
    job = block(20, 20, passes=passes)
    early = printed(job, factor, 1, job.mask.astype(np.int32)).ink_scale
    late = printed(job, factor, 30, job.mask.astype(np.int32)).ink_scale
    assert abs(late - factor) <= abs(early - factor) + 1e-3
    assert late == pytest.approx(factor, abs=0.01)


def test_nominal_ink_is_kept_on_request() -> None:
    job = block()
    assert printed(job, 0.8, 5, job.mask.astype(np.int32), adapt_ink=False).ink_scale == 1.0


def test_ink_scale_is_frozen_while_nothing_is_printed() -> None:
    job = block(20, 20)
    estimator, everywhere = HeightEstimator(job), np.ones((20, 20), np.bool_)
    before = printed(job, 0.85, 5, job.mask.astype(np.int32))
    noise = np.random.default_rng(2).normal(0.0, 1e-6, (20, 20))
    for droplets in (0, 3):
        pattern = np.zeros((20, 20), np.int32)
        pattern[10, 5 : 5 + droplets] = 1
        after = estimator.next(before, pattern, 6, before.height + noise, everywhere)
        assert (after.ink_scale, after.measured, after.expected) == (before.ink_scale, before.measured, before.expected)
        np.testing.assert_array_equal(after.height, before.height + noise)


def test_invalid_cells_are_predicted_and_say_nothing_about_the_ink() -> None:
    job = block(20, 20)
    pattern = job.mask.astype(np.int32)
    estimator, everywhere = HeightEstimator(job), np.ones((20, 20), np.bool_)
    before = printed(job, 0.9, 5, pattern)
    valid = everywhere.copy()
    valid[4:9, 4:9] = False
    surface = LayerModel.of(job).scaled(0.9).layer(before.height, pattern, 6)
    garbage = np.where(valid, surface, np.nan)
    after = estimator.next(before, pattern, 6, garbage, valid)
    predicted = LayerModel.of(job).scaled(before.ink_scale).layer(before.height, pattern, 6)
    np.testing.assert_array_equal(after.height, np.where(valid, surface, predicted))
    assert after.ink_scale == pytest.approx(0.9, abs=0.01)


def test_unmeasured_start_surface_is_bare_substrate() -> None:
    job = block()
    valid = np.zeros((job.nx, job.ny), np.bool_)
    np.testing.assert_array_equal(HeightEstimator(job).first(np.full(valid.shape, 7.0), valid).height, 0.0)
