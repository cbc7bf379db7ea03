"""Places on the grid between the cells: readings there, and what lands there."""

from __future__ import annotations

from itertools import product
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap

Corners: TypeAlias = list[tuple[NDArray[np.intp], NDArray[np.intp], FloatMap]]


def across(shape: tuple[int, int]) -> tuple[FloatMap, FloatMap]:
    """Coordinates of the cells, each (nx, ny): -1 and 1 at the grid's edges, 0 in its middle."""
    u, w = (np.linspace(-1.0, 1.0, count) for count in shape)
    return np.repeat(u[:, None], shape[1], 1), np.repeat(w[None, :], shape[0], 0)


def continued(surface: FloatMap, reach: int) -> FloatMap:
    """The surface with a border of its outermost cells' heights."""
    return np.pad(surface, reach, mode="edge")


def sampled(surface: FloatMap, x: FloatMap, y: FloatMap) -> FloatMap:
    """The surface at the places (x, y) [cells], bilinear; beyond the grid its border goes on."""
    nx, ny = surface.shape
    total = np.zeros(x.shape)
    for i, j, weight in _corners(np.clip(x, 0.0, nx - 1.0), np.clip(y, 0.0, ny - 1.0)):
        total += weight * surface[np.minimum(i, nx - 1), np.minimum(j, ny - 1)]
    return total


def spread(amounts: FloatMap, x: FloatMap, y: FloatMap) -> FloatMap:
    """Amounts that land at (x, y) [cells], each divided among four cells; what lands beyond the grid is lost."""
    nx, ny = amounts.shape
    total = np.zeros(amounts.shape)
    for i, j, weight in _corners(x, y):
        inside = (i >= 0) & (i < nx) & (j >= 0) & (j < ny)
        np.add.at(total, (i[inside], j[inside]), (weight * amounts)[inside])
    return total


def height_range(surface: FloatMap) -> FloatMap:
    """Highest less lowest of the 3 x 3 cells around each cell."""
    nx, ny = surface.shape
    around = continued(surface, 1)
    block = np.stack([around[di : di + nx, dj : dj + ny] for di, dj in product(range(3), repeat=2)])
    return np.asarray(block.max(axis=0) - block.min(axis=0))


def _corners(x: FloatMap, y: FloatMap) -> Corners:
    """The four cells around each place and their bilinear weights."""
    i, j = np.floor(x).astype(np.intp), np.floor(y).astype(np.intp)
    s, t = x - i, y - j
    return [
        (i, j, (1.0 - s) * (1.0 - t)),
        (i + 1, j, s * (1.0 - t)),
        (i, j + 1, (1.0 - s) * t),
        (i + 1, j + 1, s * t),
    ]
