"""Flaws of a part: holes of its mesh, and walls and gaps that are narrower than droplets can make them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap, FloatMap
from inkloop.geometry import Columns
from inkloop.geometry.body import Body
from inkloop.geometry.mending import open_edges, welded
from inkloop.geometry.mesh_columns import Fine


@dataclass(frozen=True)
class Hole:
    """Connected edges: their number, the middle of the box around them [m], and its diagonal [m].

    is_seam: no face is missing, but the two at an edge point to opposite sides.
    """

    edges: int
    center: tuple[float, float, float]
    size: float
    is_seam: bool = False


def holes(bodies: Sequence[Body]) -> list[Hole]:
    """All holes and seams, the largest first; none of a watertight mesh, also where bodies touch or overlap."""
    corners, index = welded(np.concatenate([body.triangles for body in bodies]))
    edges, ways = open_edges(index)
    rims = {False: ways % 2 == 1, True: ways % 2 == 0}
    found = [hole for is_seam, rim in rims.items() for hole in _chains(corners, edges[rim], is_seam)]
    return sorted(found, key=lambda hole: -hole.size)


def solids(body: Body) -> int:
    """Number of separate solids: surfaces without a common corner, those around cavities left out; at least 1.

    Of a body that is cut: columns that touch.
    """
    if len(body.cut):
        return _pieces(Fine.of([body]).left)
    corners, index = welded(body.triangles)
    labels = _connected(len(corners), index[:, [0, 1, 1, 2]].reshape(-1, 2))
    a, b, c = np.moveaxis(body.triangles - corners.mean(axis=0), 1, 0)
    volumes = np.bincount(labels[index[:, 0]], np.einsum("ij,ij->i", a, np.cross(b, c)))
    return max(1, int((volumes > 0.0).sum()))


def _pieces(part: Columns) -> int:
    """Number of pieces: intervals are of one if they share a height over neighbouring cells."""
    edges = [np.empty((0, 2), np.int64)]
    cell, counts = part.cells, part.counts.ravel()
    i, j = np.divmod(cell, part.ny)
    for step, has_next in ((part.ny, i < part.nx - 1), (1, j < part.ny - 1)):
        own = np.flatnonzero(has_next)
        for k in range(counts.max(initial=0)):
            own = own[counts[cell[own] + step] > k]
            other = part.offsets[cell[own] + step] + k
            meets = (part.bottoms[other] < part.tops[own]) & (part.bottoms[own] < part.tops[other])
            edges.append(np.stack([own[meets], other[meets]], axis=-1))
    return int(_connected(cell.size, np.concatenate(edges)).max(initial=-1)) + 1


def _connected(count: int, edges: NDArray[np.int64]) -> NDArray[np.int32]:
    """Number of the connected component of each of `count` points; edges: indices of two points (n, 2)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(edges)), tuple(edges.T)), shape=(count, count))
    labels: NDArray[np.int32] = connected_components(graph, directed=False)[1]
    return labels


def _chains(corners: FloatMap, rim: NDArray[np.int64], is_seam: bool) -> Iterator[Hole]:
    """Edges by connected component; rim: indices of their two corners (n, 2)."""
    if not len(rim):
        return
    used, ends = np.unique(rim, return_inverse=True)
    ends = ends.reshape(-1, 2)
    labels = _connected(used.size, ends)
    for number in range(labels.max() + 1):
        points = corners[used[labels == number]]
        low, high = points.min(axis=0), points.max(axis=0)
        x, y, z = (float(value) for value in (low + high) / 2)
        edges = int((labels[ends[:, 0]] == number).sum())
        yield Hole(edges, (x, y, z), float(np.linalg.norm(high - low)), is_seam)


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
    cell = part.cells
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
