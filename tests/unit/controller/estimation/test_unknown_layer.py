"""A layer that was given up midway: its scan is the surface, and nothing is learnt from it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inkloop.component import Job
from inkloop_controller.controllers import LayerMpcController
from inkloop_controller.estimation.height_estimator import Estimate, HeightEstimator
from inkloop_controller.layer_controller import LayerController
from inkloop_controller.model.layer_model import LayerModel
from support.closed_loop import block, cylinder, inputs_of

NOISE = 1e-6
UNKNOWN = 6


def half_jetted(job: Job) -> Any:
    """The part up to the middle line: there the head stopped."""
    return np.where(np.indices(job.mask.shape)[0] < job.nx // 2, job.mask, 0).astype(np.int32)


def printed(unknown_layer: int, noise: float = NOISE) -> tuple[Job, Estimate, Estimate, Any]:
    """The estimates before and after the layer that half of was jetted, and the surface; droplets bring 80 %."""
    job, rng = cylinder(), np.random.default_rng(2)
    estimator, plant, whole = HeightEstimator(job), LayerModel.of(job).scaled(0.8), job.mask.astype(np.int32)
    seen, height = np.ones(job.mask.shape, np.bool_), np.zeros(job.mask.shape)

    def scan() -> Any:
        return height + noise * rng.standard_normal(height.shape)

    estimate = before = estimator.first(scan(), seen)
    for layer in range(1, unknown_layer + 1):
        before, is_unknown = estimate, layer == unknown_layer
        height = plant.layer(height, half_jetted(job) if is_unknown else whole, layer)
        estimate = estimator.next(before, whole, layer, scan(), seen, is_unknown=is_unknown)
    return job, before, estimate, height


@pytest.mark.parametrize("layer", [1, UNKNOWN])
def test_surface_of_an_unknown_layer_is_that_of_its_scan(layer: int) -> None:
    """As far as noisy ground shows the datum of the scan."""
    job, _, estimate, height = printed(layer)
    error = (estimate.height - height)[job.mask]
    assert np.std(error) < 1.2 * NOISE
    assert abs(error.mean()) < 0.8 * NOISE
    exact, _, estimate, height = printed(layer, noise=0.0)
    np.testing.assert_allclose(estimate.height[exact.mask], height[exact.mask], rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("layer", [1, UNKNOWN])
def test_nothing_is_learnt_of_ink_nozzles_noise_and_geometry_from_an_unknown_layer(layer: int) -> None:
    _, before, estimate, _ = printed(layer)
    assert before.ink_scale == pytest.approx(0.8 if layer > 1 else 1.0, abs=0.04)
    assert (estimate.inks, estimate.ink_scale) == (before.inks, before.ink_scale)
    np.testing.assert_array_equal(estimate.state["dead_evidence"], before.state["dead_evidence"])
    one, other = before.figures, estimate.figures
    for name in ("noise_std", "droplet_std", "surprise", "shift_x", "shift_y", "rotation", "magnification"):
        assert getattr(one, name) == getattr(other, name), name
    assert not other.reasons


def test_layers_after_an_unknown_one_are_trusted_and_the_ink_is_learnt_on() -> None:
    job, _, estimate, height = printed(2)
    estimator, plant, whole = HeightEstimator(job), LayerModel.of(job).scaled(0.8), job.mask.astype(np.int32)
    rng, seen = np.random.default_rng(3), np.ones(job.mask.shape, np.bool_)
    for layer in range(3, 7):
        height = plant.layer(height, whole, layer)
        scan = height + NOISE * rng.standard_normal(height.shape)
        estimate = estimator.next(estimate, whole, layer, scan, seen)
        assert not estimate.figures.reasons
    assert estimate.ink_scale == pytest.approx(0.8, abs=0.04)
    assert np.sqrt(np.mean((estimate.height - height)[job.mask] ** 2)) < NOISE


def test_cell_of_an_unknown_layer_that_was_not_seen_may_be_anything_between_nothing_and_all() -> None:
    job = block()
    estimator, whole = HeightEstimator(job, adapt_ink="off"), job.mask.astype(np.int32)
    flat, seen = np.zeros(job.mask.shape), np.ones(job.mask.shape, np.bool_)
    start = estimator.first(flat, seen)
    full = LayerModel.of(job).layer(flat, whole, 1)
    estimate = estimator.next(start, whole, 1, flat, ~seen, is_unknown=True)
    np.testing.assert_allclose(estimate.height[job.mask], 0.5 * full[job.mask])
    np.testing.assert_allclose(np.sqrt(12.0 * estimate.height_variance[job.mask]), full[job.mask], rtol=1e-6)


def test_controller_plans_on_from_the_scan_of_an_unknown_layer() -> None:
    """Layer 1 lacks a third: from a layer that is known the controller would conclude that the ink is weak."""
    job = block(16, 16)

    def answered(is_unknown: bool) -> Any:
        controller = LayerMpcController(job, horizon=1)
        assert isinstance(controller, LayerController)
        controller.initialize(0, inputs_of(job, np.zeros(job.mask.shape), 0))
        first = controller.do_step(0, 1, inputs_of(job, np.zeros(job.mask.shape), 0))
        surface = LayerModel.of(job).scaled(0.67).layer(np.zeros(job.mask.shape), first["pattern"], 1)
        inputs = inputs_of(job, surface, 1) | {"layer_unknown": np.asarray(is_unknown)}
        return controller.do_step(1, 1, inputs)

    unknown, known = answered(is_unknown=True), answered(is_unknown=False)
    assert unknown["layer_command"] == known["layer_command"] == 2
    np.testing.assert_allclose(unknown["estimated_height"], known["estimated_height"], atol=1e-8)
    assert (float(unknown["volume_scale"]), float(known["volume_scale"])) == (1.0, pytest.approx(0.67, abs=0.1))
