"""Walls and gaps that are narrower than droplets can make them, from runs of cells and from intervals."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from inkloop.component import BoolMap
from inkloop.geometry.columns import Columns


@dataclass(frozen=True, eq=False)
class Narrow:
    """Places narrower than a limit. cells: (nx, ny), those concerned; first: (x, y, z) of the first [m]."""

    cells: BoolMap
    first: tuple[float, float, float]


def narrow_across(part: Columns, limit: int, levels: Iterable[float]) -> tuple[Narrow | None, Narrow | None]:
    """Walls, and gaps between two walls, of fewer than `limit` cells along x or y at the heights of `levels` [m]."""
    shape = part.nx, part.ny
    found = [np.zeros(shape, np.bool_), np.zeros(shape, np.bool_)]
    lowest = [0.0, 0.0]
    for z in levels:
        inside = part.inside(np.full(shape, z))
        for kind, here in enumerate((_short(inside, limit, at_edges=True), _short(~inside, limit, at_edges=False))):
            if here.any() and not found[kind].any():
                lowest[kind] = z
            found[kind] |= here & (~found[kind])
    return _narrow(part, found[0], lowest[0]), _narrow(part, found[1], lowest[1])


def narrow_upright(part: Columns, limit: float) -> tuple[Narrow | None, Narrow | None]:
    """Intervals, and gaps between two of them, lower than `limit` [m]."""
    cell = np.repeat(np.arange(part.nx * part.ny), part.counts.ravel())
    is_next = cell[1:] == cell[:-1]
    walls = part.tops - part.bottoms < limit
    gaps = is_next & (part.bottoms[1:] - part.tops[:-1] < limit)
    found = []
    for cells, heights in ((cell[walls], part.bottoms[walls]), (cell[:-1][gaps], part.tops[:-1][gaps])):
        marks = np.zeros((part.nx, part.ny), np.bool_)
        marks.ravel()[cells] = True
        found.append(_narrow(part, marks, float(heights[0]) if cells.size else 0.0))
    return found[0], found[1]


def _short(inside: BoolMap, limit: int, *, at_edges: bool) -> BoolMap:
    """Cells in runs of True shorter than `limit` along either axis; at_edges: runs at the rim of the grid count."""
    return _short_along_rows(inside, limit, at_edges) | _short_along_rows(inside.T, limit, at_edges).T


def _short_along_rows(inside: BoolMap, limit: int, at_edges: bool) -> BoolMap:
    rows, length = inside.shape
    steps = np.diff(np.pad(inside, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    row, begin = np.nonzero(steps == 1)
    end = np.nonzero(steps == -1)[1]
    kept = end - begin < limit
    if not at_edges:
        kept &= (begin > 0) & (end < length)
    marks = np.zeros((rows, length + 1), np.int32)
    np.add.at(marks, (row[kept], begin[kept]), 1)
    np.add.at(marks, (row[kept], end[kept]), -1)
    short: BoolMap = np.cumsum(marks, axis=1)[:, :-1] > 0
    return short


def _narrow(part: Columns, cells: BoolMap, z: float) -> Narrow | None:
    if not cells.any():
        return None
    i, j = (int(index[0]) for index in np.nonzero(cells))
    return Narrow(cells, (i * part.pitch, j * part.pitch, z))
