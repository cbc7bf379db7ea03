"""Cells of the grid: their centres, and the cell of a point."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap


def check_grid(nx: int, ny: int, pitch: float) -> None:
    """Raises ValueError for a grid without cells or size."""
    if nx < 1 or ny < 1 or not 0.0 < pitch < np.inf:
        raise ValueError(f"a grid of {nx} x {ny} cells of {pitch} m; needs at least one and a length above 0")


def cell_centers(nx: int, ny: int, pitch: float) -> tuple[FloatMap, FloatMap]:
    """x and y of every cell, each (nx, ny) [m]."""
    x, y = np.meshgrid(np.arange(nx) * pitch, np.arange(ny) * pitch, indexing="ij")
    return x, y


def cell_index(x: FloatMap, y: FloatMap, nx: int, ny: int, pitch: float) -> NDArray[np.int64]:
    """i * ny + j of the cell with the nearest centre, -1 outside the grid; a point between two centres is in the upper.

    x, y: [m], broadcast against each other.
    """
    i, j = np.floor(np.asarray(x) / pitch + 0.5), np.floor(np.asarray(y) / pitch + 0.5)
    is_on_grid = (i >= 0) & (i < nx) & (j >= 0) & (j < ny)  # False for NaN
    index: NDArray[np.int64] = np.where(is_on_grid, i * ny + j, -1.0).astype(np.int64)
    return index
