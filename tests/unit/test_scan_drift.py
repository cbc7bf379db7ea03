"""What is drift of the sensor and what is not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from closed_loop import cylinder
from inkloop_controller.scan_drift import ScanDrift

PART = cylinder().mask
ROW, COLUMN = np.indices(PART.shape)
SUBSTRATE = 40e-6 + 2e-6 * ROW - 1e-6 * COLUMN + np.random.default_rng(0).normal(0.0, 5e-6, PART.shape)
SEEN = np.ones(PART.shape, np.bool_)
PLANE = 3e-6 + 0.2e-6 * ROW - 0.5e-6 * COLUMN


def plane(scan: Any, known: Any = SUBSTRATE, valid: Any = SEEN, part: Any = PART) -> Any:
    return ScanDrift(part).seen(scan, known, valid).plane


def test_offset_and_tilt_since_the_known_surface_are_found_whatever_was_printed() -> None:
    grown = SUBSTRATE + np.where(PART, 50e-6, 0.0)
    np.testing.assert_allclose(plane(grown + PLANE), PLANE, atol=1e-13)


def test_tilted_uneven_substrate_is_no_drift() -> None:
    np.testing.assert_array_equal(plane(SUBSTRATE), 0.0)


def test_reference_is_out_of_reach_of_every_droplet() -> None:
    near = np.zeros(PART.shape, np.bool_)
    for i, j in zip(*np.nonzero(PART), strict=True):
        near[i - 1 : i + 2, j - 1 : j + 2] = True
    np.testing.assert_array_equal(ScanDrift(PART).cells, ~near)


def test_some_soiled_cells_do_not_move_the_plane() -> None:
    soiled = SUBSTRATE + PLANE
    soiled[:5, :5] += 30e-6
    np.testing.assert_allclose(plane(soiled), PLANE, atol=1e-13)


def test_cells_that_were_not_seen_do_not_count() -> None:
    valid = SEEN.copy()
    valid[:4] = False
    np.testing.assert_allclose(plane(np.where(valid, SUBSTRATE + PLANE, 1.0), valid=valid), PLANE, atol=1e-13)


@pytest.mark.parametrize("margin", [0, 1])
def test_part_without_unprinted_cells_has_no_drift_removed(margin: int) -> None:
    part = np.zeros((12, 12), np.bool_)
    part[margin : 12 - margin, margin : 12 - margin] = True
    drift = ScanDrift(part).seen(np.full((12, 12), 5e-6), np.zeros((12, 12)), np.ones((12, 12), np.bool_))
    np.testing.assert_array_equal(drift.plane, 0.0)
    assert drift.residual_variance is None


def test_cells_in_one_row_tell_an_offset_but_no_plane() -> None:
    part = np.ones((20, 12), np.bool_)
    part[:2] = False
    i, _ = np.indices(part.shape)
    seen = np.ones(part.shape, np.bool_)
    found = plane(2e-6 + 1e-6 * i, np.zeros(part.shape), seen, part)
    np.testing.assert_allclose(found, 2e-6, atol=1e-13)


def test_noise_is_what_is_left_about_the_plane() -> None:
    noise = np.random.default_rng(1).normal(0.0, 1e-6, PART.shape)
    variance = ScanDrift(PART).seen(SUBSTRATE + PLANE + noise, SUBSTRATE, SEEN).residual_variance
    assert variance is not None
    assert np.sqrt(variance) == pytest.approx(1e-6, rel=0.1)
