"""Sal, Str and Std follow from pairs of cells: exact autocorrelation, known textures, and refusals."""

from __future__ import annotations

from math import acos, cos, degrees, log, pi, radians, sin, sqrt

import numpy as np
import pytest

from inkloop.metrology.evaluation.areal import autocorrelation
from support.evaluated import PERIOD, STEP, A, areal, map_of, number, reason, rough, surface_of, texture, wave


def test_the_autocorrelation_is_the_mean_over_existing_pairs() -> None:
    """Pair by pair on a small map with a hole and a mask."""
    z, mask = rough((9, 8)), np.ones((9, 8), bool)
    mask[:2, :3] = mask[5, 4] = False
    surface = surface_of(map_of(np.where(mask, z, np.nan)), f_operation="none")
    found, pairs = autocorrelation(surface)
    square = np.mean(surface.heights**2)
    for di, dj in ((0, 0), (1, 0), (0, -3), (4, 5), (-6, 2)):
        i, j = np.nonzero(mask)
        inside = (i + di >= 0) & (i + di < 9) & (j + dj >= 0) & (j + dj < 8)
        i, j = i[inside], j[inside]
        both = mask[i + di, j + dj]
        products = surface.z[i, j][both] * surface.z[i + di, j + dj][both]
        assert pairs[8 + di, 7 + dj] == both.sum()
        assert found[8 + di, 7 + dj] == pytest.approx(products.mean() / square, rel=1e-9, abs=1e-12)


def test_a_sinusoid_falls_to_a_fifth_at_its_arc_cosine() -> None:
    """On half periods of a long map; along the ridges it never falls: Str has a bound instead of a value."""
    found = areal(map_of(wave(40 * PERIOD, 30)), f_operation="none")
    assert number(found, "Sal") == pytest.approx(PERIOD * acos(0.2) / (2 * pi) * STEP, rel=5e-3, abs=0.0)
    # the longest ray of those that stay within that arc: 8.72 cells to the side of 22 rows, at which a quarter is left
    assert reason(found, "Str") == (
        "along 69 deg the autocorrelation does not fall to 0.2 within 235.7 µm, the longest lag: Str is below 0.37"
    )
    assert number(found, "Std") == pytest.approx(pi / 2, abs=0.02)


@pytest.mark.parametrize("sigma", [(3.0, 3.0), (3.0, 9.0)])
def test_a_gaussian_texture_has_its_lengths(sigma: tuple[float, float]) -> None:
    """exp(-(t / 2 sigma)^2) is 0.2 at 2 sigma sqrt(ln 5); the statistics of one map scatter."""
    found = areal(map_of(texture(sigma)), f_operation="none")
    assert number(found, "Sal") == pytest.approx(2 * min(sigma) * sqrt(log(5)) * STEP, rel=0.08, abs=0.0)
    assert number(found, "Str") == pytest.approx(min(sigma) / max(sigma), rel=0.25, abs=0.0)


def test_the_finer_pitch_limits_lengths_and_the_coarser_one_the_lay() -> None:
    found = areal(map_of(texture((1.0, 1.0)), STEP, 3 * STEP), f_operation="none")
    assert number(found, "Sal") == pytest.approx(2 * sqrt(log(5)) * STEP, rel=0.08, abs=0.0)
    strip = areal(map_of(texture((8, 8), (200, 6)), STEP, 2 * STEP))
    assert "the longest lag in the narrowest direction is 4.0 steps; needs 5" in reason(strip, "Std")
    i, j = np.indices((90, 90))
    z = 1.5 * np.sin(2 * pi * i / 3) + np.sin(
        2 * pi * j / 5
    )  # periods of 3 and of 10 steps, of which pixels along y have 2
    std = degrees(number(areal(map_of(A * z, STEP, 2 * STEP), f_operation="none"), "Std"))
    assert min(std, 180 - std) < 1.5


@pytest.mark.parametrize("angle", [0, 30, 90, 155])
def test_the_lay_has_its_direction(angle: int) -> None:
    """Ridges at an angle from x towards y, on a disc, with pixels that are no squares."""
    dx, dy = STEP, 1.5 * STEP
    i, j = np.indices((90, 60))
    across = -sin(radians(angle)) * i * dx + cos(radians(angle)) * j * dy
    z = A * np.sin(2 * pi * across / (15 * STEP)) + 0.3 * texture((1, 1), (90, 60))
    mask = np.hypot((i - 45) * dx, (j - 30) * dy) < 43 * STEP
    found = degrees(number(areal(map_of(z, dx, dy), mask), "Std"))
    assert min(abs(found - angle), 180 - abs(found - angle)) <= 1.5


def test_mirror_and_quarter_turn_move_the_lay() -> None:
    i, j = np.indices((64, 64))
    z = A * np.sin(2 * pi * (i * cos(0.5) + j * sin(0.5)) / 9)
    std = degrees(number(areal(map_of(z)), "Std"))
    assert degrees(number(areal(map_of(z[::-1])), "Std")) == pytest.approx(180 - std, abs=1e-6)
    assert degrees(number(areal(map_of(np.rot90(z))), "Std")) == pytest.approx((std + 90) % 180, abs=1e-6)


def test_what_the_map_cannot_show_is_refused() -> None:
    noise = np.random.default_rng(1).normal(size=(60, 60))
    found = areal(map_of(A * noise))
    assert "below one pitch" in reason(found, "Sal")
    assert "no direction stands out" in reason(found, "Std")
    assert "no direction stands out" in reason(areal(map_of(texture((3, 3)))), "Std")
    strip = areal(map_of(texture((8, 8), (200, 3))))
    assert "too narrow in one direction" in reason(strip, "Sal")
    assert "the longest lag in the narrowest direction is 2" in reason(strip, "Std")


def test_a_wave_counts_by_its_power_and_its_frequency() -> None:
    """Twice as many ridges make up for less than twice the power."""
    i, j = np.indices((96, 96))
    z = 1.2 * np.sin(2 * pi * i / 16) + np.sin(2 * pi * j / 8)
    std = degrees(number(areal(map_of(A * z), f_operation="none"), "Std"))
    assert min(std, 180 - std) < 1.5, "the ridges of the wave along y"


def test_a_mask_is_one_piece_where_cells_touch_by_corners_or_lack_a_height() -> None:
    z, mask = texture((2, 2), (40, 30)), np.zeros((40, 30), bool)
    mask[:20, :15] = mask[20:, 15:] = True
    assert number(areal(map_of(z), mask), "Sal") > 0.0
    z[20] = np.nan
    assert number(areal(map_of(z)), "Sal") > 0.0


def test_a_mask_in_pieces_has_no_texture() -> None:
    mask = np.ones((40, 30), bool)
    mask[20] = False
    found = areal(map_of(texture((2, 2), (40, 30))), mask)
    for symbol in ("Sal", "Str", "Std"):
        assert "the mask has 2 pieces" in reason(found, symbol)
    assert number(found, "Sa") > 0.0
