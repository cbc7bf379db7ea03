"""The datum of a scan: offset, tilt and bow are taken off, found on ground that no droplet reaches."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from inkloop_controller.estimation.estimate_figures import UntrustedReason
from inkloop_controller.estimation.height_estimator import Estimate, HeightEstimator
from inkloop_controller.model import LayerModel
from support.closed_loop import block, cylinder

JOB = cylinder()
PART = JOB.mask
ROW, COLUMN = np.indices(PART.shape)
U, W = ROW / 17.0 - 1.0, COLUMN / 17.0 - 1.0
SEEN = np.ones(PART.shape, np.bool_)
PLANE = 3e-6 + 2e-6 * U - 4e-6 * W
BOW = PLANE + 1e-6 * U * U - 2e-6 * U * W + 1.5e-6 * W * W
ROUGH = np.random.default_rng(0).normal(0.0, 5e-6, PART.shape)
TOLERANCE = 1e-8  # [m]


def first(scan: Any, layer: int = 0, valid: Any = SEEN, **options: Any) -> Estimate:
    return HeightEstimator(JOB, sensor_noise_std=0.0, **options).first(scan, valid, layer)


def after(scan: Any, start: Any, *, flat: bool = False, valid: Any = SEEN, part: Any = PART) -> Estimate:
    """A scan of a surface on which nothing was printed since the start was scanned."""
    nx, ny = part.shape
    job = replace(JOB, nx=nx, ny=ny, mask=part, target_height=np.where(part, 400e-6, 0.0))
    estimator = HeightEstimator(job, sensor_noise_std=0.0, flat_ground=flat)
    known = estimator.first(start, np.ones(part.shape, np.bool_))
    return estimator.next(known, np.zeros(part.shape, np.int32), 1, scan, valid)


@pytest.mark.parametrize("datum", [np.zeros(PART.shape), PLANE, BOW], ids=["none", "plane", "bow"])
def test_datum_of_flat_ground_is_taken_off_from_the_first_scan_on(datum: Any) -> None:
    found = first(datum)
    np.testing.assert_array_equal(found.height, 0.0)
    assert not found.figures.reasons
    np.testing.assert_allclose(after(datum, datum, flat=True).height, 0.0, rtol=0.0, atol=TOLERANCE)


@pytest.mark.parametrize(("layers", "is_wrong"), [(1.0, False), (-2.5, False), (3.5, True), (-3.5, True), (20.0, True)])
def test_ground_further_off_than_three_layers_is_not_the_flat_one(layers: float, is_wrong: bool) -> None:
    scan = np.full(PART.shape, layers * 7.6e-6)
    assert first(scan).figures.reasons == (UntrustedReason.GROUND if is_wrong else UntrustedReason(0))


def test_ground_counts_on_layer_0_and_where_it_is_called_flat_only() -> None:
    high = np.full(PART.shape, 40e-6)
    assert not any(first(high, layer=layer).figures.reasons & UntrustedReason.GROUND for layer in (1, 41))
    assert not first(high, flat_ground=False).figures.reasons & UntrustedReason.GROUND
    assert not first(high, take_as_read=True).figures.reasons & UntrustedReason.GROUND


@pytest.mark.parametrize("along", [0, 1])
def test_ground_of_a_line_of_cells_has_no_rise_across_it(along: int) -> None:
    job = block(20, 18, height=60e-6)
    line = np.indices((20, 18))[along] == 4
    scan = np.where(line, 8.5e-6, 0.0)
    found = HeightEstimator(job, sensor_noise_std=0.0).first(scan, line)
    np.testing.assert_array_equal(found.height, 0.0)
    assert all(np.isfinite(found.figures.ground))
    assert abs(found.figures.ground[2 - along]) < 8.5e-6


@pytest.mark.parametrize("datum", [PLANE, BOW], ids=["plane", "bow"])
def test_datum_since_a_rough_known_surface_is_taken_off(datum: Any) -> None:
    np.testing.assert_allclose(after(ROUGH + datum, ROUGH).height, ROUGH, rtol=0.0, atol=TOLERANCE)


def test_some_soiled_cells_do_not_move_the_datum() -> None:
    soiled = ROUGH + PLANE
    soiled[:4, :4] += 30e-6
    found = after(soiled, ROUGH)
    np.testing.assert_allclose(found.height[PART], ROUGH[PART], rtol=0.0, atol=5e-8)


@pytest.mark.parametrize("margin", [0, 1])
def test_part_without_unprinted_cells_has_no_datum_taken_off(margin: int) -> None:
    part = np.zeros((12, 12), np.bool_)
    part[margin : 12 - margin, margin : 12 - margin] = True
    start = np.random.default_rng(2).uniform(0.0, 5e-6, part.shape)
    found = after(start, start, part=part, valid=part | True)
    np.testing.assert_allclose(found.height, start, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("noise_um", [0.2, 1.0])
def test_drift_of_offset_tilt_and_bow_over_a_print_leaves_surface_and_ink_as_they_are(noise_um: float) -> None:
    rng, estimator, plant = np.random.default_rng(3), HeightEstimator(JOB), LayerModel.of(JOB).scaled(0.9)
    terms = np.stack([np.ones(PART.shape), U, W, U * U, U * W, W * W])
    height, pattern = np.zeros(PART.shape), PART.astype(np.int32)

    def scan() -> Any:
        datum = np.tensordot(np.array([3.0, 3.0, 3.0, 1.0, 1.0, 1.0]) * rng.standard_normal(6), terms, 1)
        return height + (datum + noise_um * rng.standard_normal(PART.shape)) * 1e-6

    estimate = estimator.first(scan(), SEEN)
    for layer in range(1, 13):
        height = plant.layer(height, pattern, layer, 1.0 - 0.2 * rng.random(PART.shape))
        estimate = estimator.next(estimate, pattern, layer, scan(), SEEN)
    error = (estimate.height - height)[PART]
    assert np.sqrt(np.mean(error**2)) < noise_um * 1e-6
    assert abs(error.mean()) < 0.5e-6
    assert estimate.ink_scale == pytest.approx(0.81, abs=0.02)
    assert not estimate.figures.reasons


@pytest.mark.parametrize("shape", [(15, 13), (13, 9), (9, 13)])
def test_noise_is_learnt_right_on_little_ground(shape: tuple[int, int]) -> None:
    """The datum takes six degrees of freedom from some forty cells."""
    job, seen, nothing = block(*shape), np.ones(shape, np.bool_), np.zeros(shape, np.int32)
    estimator, found = HeightEstimator(job, register_scans=False), []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        estimate = estimator.first(rng.normal(0.0, 1e-6, shape), seen)
        for layer in range(1, 9):
            estimate = estimator.next(estimate, nothing, layer, rng.normal(0.0, 1e-6, shape), seen)
            found.append(estimate.figures.noise_std**2)
    assert np.sqrt(np.mean(found)) == pytest.approx(1e-6, rel=0.05, abs=0.0)


def test_much_ground_of_the_first_scan_outweighs_little_of_later_ones() -> None:
    job, seen = block(41, 39), np.ones((41, 39), np.bool_)
    estimator, weights = HeightEstimator(job, register_scans=False), []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        before = estimator.first(rng.normal(0.0, 1e-6, seen.shape), seen)
        after = estimator.next(before, np.zeros(seen.shape, np.int32), 1, rng.normal(0.0, 3e-6, seen.shape), seen)
        first, both = before.figures.noise_std**2, after.figures.noise_std**2
        weights.append((both - first) / (9e-12 - first))
    # 150 of 150 + 0.7 * 794 degrees of freedom: every second cell is looked at
    assert np.mean(weights) == pytest.approx(0.213, abs=0.04)


def test_noise_of_a_reading_is_what_is_left_about_the_datum_though_the_first_scan_has_it_too() -> None:
    rng, found = np.random.default_rng(1), []
    for _ in range(10):
        estimator = HeightEstimator(JOB, flat_ground=False)
        first_scan, second = (ROUGH + rng.normal(0.0, 1e-6, PART.shape) for _ in range(2))
        before = estimator.first(first_scan, SEEN)
        known = estimator.next(before, np.zeros(PART.shape, np.int32), 1, second + PLANE, SEEN)
        found.append(known.figures.noise_std**2)
    assert np.sqrt(np.mean(found)) == pytest.approx(1e-6, rel=0.1, abs=0.0)
