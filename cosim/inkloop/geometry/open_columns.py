"""Fill columns that holes of a surface leave open by the intervals of a neighbour."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from inkloop.geometry.columns import Columns

_SIDES = ((-1, 0), (0, -1), (0, 1), (1, 0))


def filled_by_neighbours(columns: Columns, open_cells: NDArray[np.int64]) -> Columns:
    """Every open cell gets the column of the neighbour with the median filled height, from the rim of a hole inwards.

    open_cells: i ny + j; at least one cell must be closed. Of two neighbours in the middle the lower one counts.
    """
    cells = columns.nx * columns.ny
    source = np.arange(cells)
    source[open_cells] = -1
    filled = np.concatenate([[0.0], np.cumsum(columns.tops - columns.bottoms)])
    filled = np.diff(filled[columns.offsets])
    left = open_cells
    while left.size:
        around = _neighbours(left, columns.nx, columns.ny)
        known = np.where(around >= 0, source[around], -1)
        height = np.where(known >= 0, filled[known], np.inf)
        order = np.argsort(height, axis=0, kind="stable")
        count = (known >= 0).sum(axis=0)
        middle = np.take_along_axis(order, np.maximum(count - 1, 0)[None] // 2, axis=0)
        source[left] = np.take_along_axis(known, middle, axis=0)[0]
        left = left[count == 0]
    return _rearranged(columns, source)


def _neighbours(cell: NDArray[np.int64], nx: int, ny: int) -> NDArray[np.int64]:
    """The four neighbours of each cell, (4, cells), -1 beyond the edge."""
    i, j = np.divmod(cell, ny)
    at = [(i + di, j + dj) for di, dj in _SIDES]
    return np.stack([np.where((k >= 0) & (k < nx) & (m >= 0) & (m < ny), k * ny + m, -1) for k, m in at])


def _rearranged(columns: Columns, source: NDArray[np.int64]) -> Columns:
    """Cell c gets the column of cell source[c]."""
    counts = np.diff(columns.offsets)[source]
    offsets = np.concatenate([[0], np.cumsum(counts)])
    take = np.repeat(columns.offsets[source] - offsets[:-1], counts) + np.arange(offsets[-1])
    return Columns(columns.nx, columns.ny, columns.pitch, offsets, columns.bottoms[take], columns.tops[take])
