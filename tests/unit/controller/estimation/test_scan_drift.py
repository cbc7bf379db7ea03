"""What is drift of the sensor and what is not: the estimate of an exact scan is the scan without it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from inkloop_controller.estimation.height_estimator import HeightEstimator
from support.closed_loop import cylinder

PART = cylinder().mask
ROW, COLUMN = np.indices(PART.shape)
SUBSTRATE = 40e-6 + 2e-6 * ROW - 1e-6 * COLUMN + np.random.default_rng(0).normal(0.0, 5e-6, PART.shape)
SEEN = np.ones(PART.shape, np.bool_)
PLANE = 3e-6 + 0.2e-6 * ROW - 0.5e-6 * COLUMN
NEAR = np.lib.stride_tricks.sliding_window_view(np.pad(PART, 1), (3, 3)).any(axis=(2, 3))


def plane(scan: Any, known: Any = SUBSTRATE, valid: Any = SEEN, part: Any = PART) -> Any:
    """What is taken off a scan after one of `known`, NaN where the scan was not valid."""
    nx, ny = part.shape
    job = replace(cylinder(), nx=nx, ny=ny, mask=part, target_height=np.where(part, 400e-6, 0.0))
    estimator = HeightEstimator(job, sensor_noise_std=0.0)
    first = estimator.first(known, np.ones(part.shape, np.bool_))
    after = estimator.next(first, np.zeros(part.shape, np.int32), 1, scan, valid)
    return np.where(valid, scan - after.height, np.nan)


def test_offset_and_tilt_since_the_known_surface_are_found_whatever_was_printed() -> None:
    grown = SUBSTRATE + np.where(PART, 50e-6, 0.0)
    np.testing.assert_allclose(plane(grown + PLANE), PLANE, atol=1e-13)


def test_tilted_uneven_substrate_is_no_drift() -> None:
    np.testing.assert_array_equal(plane(SUBSTRATE), 0.0)


def test_reference_is_out_of_reach_of_every_droplet() -> None:
    grown = np.random.default_rng(1).uniform(0.0, 50e-6, PART.shape)
    np.testing.assert_array_equal(plane(SUBSTRATE + np.where(NEAR, grown, 0.0)), 0.0)
    np.testing.assert_allclose(plane(np.where(NEAR, SUBSTRATE, SUBSTRATE + PLANE)), PLANE, atol=1e-13)


def test_some_soiled_cells_do_not_move_the_plane() -> None:
    soiled = SUBSTRATE + PLANE
    soiled[:5, :5] += 30e-6
    np.testing.assert_allclose(plane(soiled), PLANE, atol=1e-13)


def test_cells_that_were_not_seen_do_not_count() -> None:
    valid = SEEN.copy()
    valid[:4] = False
    found = plane(np.where(valid, SUBSTRATE + PLANE, 1.0), valid=valid)
    np.testing.assert_allclose(found[valid], PLANE[valid], atol=1e-13)  # type: ignore[index]


@pytest.mark.parametrize("margin", [0, 1])
def test_part_without_unprinted_cells_has_no_drift_removed(margin: int) -> None:
    part = np.zeros((12, 12), np.bool_)
    part[margin : 12 - margin, margin : 12 - margin] = True
    np.testing.assert_array_equal(plane(np.full((12, 12), 5e-6), np.zeros((12, 12)), part | True, part), 0.0)


def test_cells_in_one_row_determine_an_offset_but_no_plane() -> None:
    part = np.ones((20, 12), np.bool_)
    part[:2] = False
    i, _ = np.indices(part.shape)
    found = plane(2e-6 + 1e-6 * i, np.zeros(part.shape), part | True, part)
    np.testing.assert_allclose(found, 2e-6, atol=1e-13)


def test_cells_in_a_corner_determine_an_offset_but_no_plane() -> None:
    """A plane through 7 x 7 cells would be wrong by several times their noise at the other end of the part."""
    part = np.ones((20, 20), np.bool_)
    part[:8, :8] = False
    i, j = np.indices(part.shape)
    found = plane(2e-6 + 0.1e-6 * (i + j), np.zeros(part.shape), part | True, part)
    assert np.ptp(found) < 1e-12
    assert 2e-6 < found.mean() < 3.3e-6


def test_noise_of_a_reading_is_what_is_left_about_the_plane_though_the_first_scan_has_it_too() -> None:
    rng, found = np.random.default_rng(1), []
    for _ in range(10):
        estimator = HeightEstimator(cylinder())
        first, second = (SUBSTRATE + rng.normal(0.0, 1e-6, PART.shape) for _ in range(2))
        before = estimator.first(first, SEEN)
        found.append(estimator.next(before, np.zeros(PART.shape, np.int32), 1, second + PLANE, SEEN).noise_variance)
    assert np.sqrt(np.mean(found)) == pytest.approx(1e-6, rel=0.05, abs=0.0)


def test_noise_that_few_cells_show_is_that_of_what_an_offset_leaves_them() -> None:
    """Twelve cells in a row, which carry an offset, 1 um above and below by turns: eleven are left for the noise."""
    part, seen = np.ones((20, 12), np.bool_), np.ones((20, 12), np.bool_)
    part[:2] = False
    job = replace(cylinder(), nx=20, ny=12, mask=part, target_height=np.where(part, 400e-6, 0.0))
    estimator, scan = HeightEstimator(job), np.where(np.indices(part.shape)[1] % 2, 3e-6, 1e-6)
    before = estimator.first(np.zeros(part.shape), seen)
    found = estimator.next(before, np.zeros(part.shape, np.int32), 1, scan, seen).noise_variance
    assert found == pytest.approx(0.5 * 12.0 / 11.0 * 1e-12, rel=1e-9, abs=0.0)
