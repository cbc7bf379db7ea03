"""Slices on the grid: the box around what is filled, cells that see no pixel, and centres between two pixels."""

from __future__ import annotations

import numpy as np
import pytest

from inkloop.tables.shapes import Grid
from inkloop.tables.slices import Slices

GRID = Grid(nx=10, ny=8, pitch_um=100.0)
PIXEL = (50e-6, 20e-6)


def labels(*filled: tuple[int, int]) -> np.ndarray:
    found = np.zeros((8, 10), np.int8)
    for pixel in filled:
        found[pixel] = 1
    return found


def test_box_lies_around_the_pixels_that_any_slice_fills() -> None:
    """Of 8 x 10 pixels, 400 x 200 um, about (500, 300) um: pixel (2, 3) begins at 300 + 100 and 200 + 60 um."""
    whole = Slices(GRID, (500e-6, 300e-6), PIXEL).solid([("a", labels((2, 3))), ("b", labels((5, 7)))], 8e-6)
    bounds = whole.bounds
    expected = (400e-6, 600e-6, 260e-6, 360e-6)
    assert (bounds.x_min, bounds.x_max, bounds.y_min, bounds.y_max) == pytest.approx(expected, rel=1e-9, abs=0.0)
    assert whole.volume == pytest.approx(2 * 50e-6 * 20e-6 * 8e-6, rel=1e-9, abs=0.0)


@pytest.mark.parametrize("pixel", [(0, 0), (7, 9)])
def test_cell_beyond_the_first_or_the_last_pixel_is_empty(pixel: tuple[int, int]) -> None:
    """The slices lie from 310 to 710 and from 210 to 410 um: cells see the middle of pixels 1, 3, 5, 7 and 4, 9."""
    found = Slices(GRID, (510e-6, 310e-6), PIXEL).solid([("a", labels(pixel))], 8e-6).columns(10, 8, 1e-4)
    assert np.argwhere(found.mask).tolist() == ([[7, 4]] if pixel == (7, 9) else [])


@pytest.mark.parametrize(
    ("x_um", "y_um", "between"),
    [
        (490.0, 307.0, ""),
        (500.0, 307.0, "x"),
        (490.0, 300.0, "y"),
        (500.0, 300.0, "xy"),
        (500.00005, 307.0, "x"),  # within a millionth of the pitch, and not
        (500.0002, 307.0, ""),
    ],
)
def test_centres_of_cells_between_two_pixels_are_remarked(x_um: float, y_um: float, between: str) -> None:
    """The slices begin at x - 200 and y - 100 um; centres of cells lie at multiples of 100 um."""
    found = Slices(GRID, (x_um * 1e-6, y_um * 1e-6), PIXEL).solid([("a", labels((2, 3)))], 8e-6)
    assert [remark.partition(",")[0] for remark in found.remarks] == [f"along {axis}" for axis in between]
    assert all(f"(center_{axis}_um)" in remark for axis, remark in zip(between, found.remarks, strict=True))
