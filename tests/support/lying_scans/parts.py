"""Parts of the rig's prints: masks on grids of any size, and the job that prints one."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from inkloop.component import BoolMap, Ink, Job
from inkloop.units import M_PER_UM
from support.lying_scans.plant import LU, Droplet

PITCH_UM, HEIGHT_UM = 263.256, 150.0
MARGIN = 2  # bare cells between the grid's edge and the part
LETTER_F = ("#######", "#######", "##.....", "##.....", "#####..", "#####..", "##.....", "##.....", "##.....")
LETTER_SCALE = 2  # cells a character


def _ellipse(nx: int, ny: int) -> BoolMap:
    """A circle on a square grid: radius 10 cells on 25 x 25."""
    i, j = np.indices((nx, ny))
    a, b = (nx - 1) / 2, (ny - 1) / 2
    return ((i - a) / (a - MARGIN)) ** 2 + ((j - b) / (b - MARGIN)) ** 2 <= 1.0 + 1e-9


def _wall(nx: int, ny: int, width: int) -> BoolMap:
    """A wall along x, in the middle of y."""
    mask = np.zeros((nx, ny), np.bool_)
    first = (ny - width) // 2
    mask[MARGIN:-MARGIN, first : first + width] = True
    return mask


def _pillars(nx: int, ny: int) -> BoolMap:
    """Single cells, five apart."""
    mask = np.zeros((nx, ny), np.bool_)
    mask[MARGIN:-MARGIN:5, MARGIN:-MARGIN:5] = True
    return mask


def _letter(nx: int, ny: int) -> BoolMap:
    """The letter F, which is none of its own turned or mirrored images."""
    rows = np.array([[character == "#" for character in row] for row in LETTER_F])
    letter = np.kron(rows, np.ones((LETTER_SCALE, LETTER_SCALE), np.bool_))
    mask = np.zeros((nx, ny), np.bool_)
    x, y = ((room - own) // 2 for room, own in zip((nx, ny), letter.shape, strict=True))
    mask[x : x + letter.shape[0], y : y + letter.shape[1]] = letter
    return mask


def _bar(nx: int, ny: int) -> BoolMap:
    mask = np.zeros((nx, ny), np.bool_)
    mask[MARGIN:-MARGIN, MARGIN:-MARGIN] = True
    return mask


PARTS: Mapping[str, Callable[[int, int], BoolMap]] = {
    "ellipse": _ellipse,
    "bar": _bar,
    "wall of 1 cell along x": lambda nx, ny: _wall(nx, ny, 1),
    "wall of 1 cell along y": lambda nx, ny: _wall(ny, nx, 1).T,
    "wall of 2 cells along x": lambda nx, ny: _wall(nx, ny, 2),
    "wall of 2 cells along y": lambda nx, ny: _wall(ny, nx, 2).T,
    "pillars": _pillars,
    "letter F": _letter,
}


def job_of(part: str, shape: tuple[int, int], ink: Droplet = LU, drop_levels: int = 1) -> Job:
    """A part 150 um high on flat ground; the job's ink is one drop, of which a droplet of `ink` has `drop_levels`."""
    mask = PARTS[part](*shape)
    h1, h2, h3 = (ink[away] * M_PER_UM / drop_levels for away in ((0, 0), (1, 0), (1, 1)))
    target = np.where(mask, HEIGHT_UM * M_PER_UM, 0.0)
    return Job(*shape, PITCH_UM * M_PER_UM, target, np.ascontiguousarray(mask), (Ink(h1, h2, h3),))
