"""The picture of a print in an environment: which way up, which colour."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inkloop.component import Ink, Job
from inkloop_lab.environment.surface_frame import frame

MASK = np.zeros((8, 4), np.bool_)
MASK[1:6, 1:3] = True


def job(inks: int = 1) -> Job:
    return Job(8, 4, 1e-4, np.where(MASK, 20e-6, 0.0), MASK, (Ink(), Ink(9e-6, 0.0, 0.0))[:inks])


def panels(height: Any, pattern: Any, inks: int = 1) -> tuple[Any, Any]:
    """The colours of each cell (nx, ny, 3), of the surface and of the pattern."""
    image = frame(height, pattern, job(inks))
    assert image.dtype == np.uint8
    assert image.shape == (4 * 32, 17 * 32, 3)  # 256 pixels for the longer side, a cell as wide as high
    cells = image[16::32, 16::32][::-1].transpose(1, 0, 2)
    assert (cells[8] == 255).all()
    return cells[:8], cells[9:]


def test_high_cells_are_red_and_low_ones_blue_about_the_mean() -> None:
    height = job().target_height + 3e-6 * MASK  # all of it too high: nothing is uneven
    height[2, 1] += 9 * 7.6e-6 / 9
    height[4, 2] -= 9 * 7.6e-6 / 9
    surface, _ = panels(height, np.zeros((8, 4), np.int32))
    np.testing.assert_array_equal(
        panels(height, np.zeros((8, 4), np.int32), 2)[0], surface
    )  # layers are of the first ink
    assert tuple(surface[3, 1]) == (247, 247, 247)
    half = {(2, 1): (178, 24, 43), (4, 2): (33, 102, 172)}  # one layer of the two that the colours span
    for cell, end in half.items():
        np.testing.assert_allclose(surface[cell].astype(float), (247 + np.array(end)) / 2, atol=0.51)
    assert {tuple(colour) for colour in surface[~MASK]} == {(230, 230, 230)}
    height[2, 1] += 1.0
    clipped, _ = panels(height, np.zeros((8, 4), np.int32))
    assert tuple(clipped[2, 1]) == (178, 24, 43)


@pytest.mark.parametrize("inks", [1, 2])
def test_droplets_have_the_colour_of_their_ink(inks: int) -> None:
    pattern = np.zeros((8, 4), np.int32)
    pattern[2, 1], pattern[5, 2] = 1, inks
    _, droplets = panels(job().target_height, pattern, inks)
    assert tuple(droplets[2, 1]) == (40, 40, 40)
    assert tuple(droplets[5, 2]) == ((40, 40, 40) if inks == 1 else (200, 120, 20))
    assert tuple(droplets[3, 1]) == (247, 247, 247)
    assert tuple(droplets[0, 0]) == (230, 230, 230)
