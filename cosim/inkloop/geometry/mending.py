"""Mend surfaces that rounding, repeated facets or flat ones leave open; nothing is done to a closed one."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap
from inkloop.units import UM_PER_M

_ROUNDINGS = 32
"""Spacings of single precision by which corners that were equal may differ (assumed): programs compute with it."""
_DECIMALS = range(9)
_UNIT_MAX = 1e-4
"""Largest unit of the last decimal that counts as rounding, of the largest coordinate (assumed)."""
_MIX = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)  # odd, of random bits

_BLOCK = 4096
"""Triangles whose numbers a cache holds: twice as fast as all at once."""


def is_closed(triangles: NDArray[np.float64]) -> bool:
    """Whether every edge is passed as often one way as the other; wrong once in 2^60 surfaces.

    Every corner gets a random point in the plane, modulo 2^64: the areas of all triangles there sum to 0 where all
    edges cancel out.
    """
    blocks = (triangles[begin : begin + _BLOCK] for begin in range(0, len(triangles), _BLOCK))
    return sum(map(_random_area, blocks)) % 2**64 == 0


def _random_area(triangles: NDArray[np.float64]) -> int:
    x, y, z = np.moveaxis((triangles + 0.0).view(np.uint64), -1, 0)  # + 0.0: -0.0 is 0.0
    u = x * _MIX[0] + y * _MIX[1] + z * _MIX[2]
    u = (u ^ (u >> np.uint64(29))) * _MIX[1]
    v = (u ^ (u >> np.uint64(32))) * _MIX[2]
    v ^= v >> np.uint64(29)
    u, v = (each[:, 1:] - each[:, :1] for each in (u, v))
    return int((u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]).sum())


def rounding(triangles: NDArray[np.float64]) -> float:
    """Distance within which the coordinates of a file, in its unit, may be the same: by their digits or bits.

    A tenth of the corners may be stray and larger: these must not make whole bodies one point.
    """
    sizes, share = np.abs(triangles), float(np.finfo(np.float32).eps)
    largest = float(np.percentile(sizes.max(axis=2), 90.0)) if sizes.size else 0.0
    spacing = share * largest
    for unit in (10.0**-digits for digits in _DECIMALS):
        off = np.abs(np.round(triangles / unit) * unit - triangles)
        if unit <= _UNIT_MAX * largest and (off <= share * np.maximum(sizes, largest)).all():
            return max(unit, _ROUNDINGS * spacing)
    return _ROUNDINGS * spacing


def welded(triangles: NDArray[np.float64]) -> tuple[FloatMap, NDArray[np.int64]]:
    """Different corners of triangles (m, 3), and the indices of theirs (n, 3)."""
    points = triangles.reshape(-1, 3)
    order = np.lexsort(points.T)
    is_new = np.ones(len(points), np.bool_)
    is_new[1:] = (points[order[1:]] != points[order[:-1]]).any(axis=1)
    index = np.empty(len(points), np.int64)
    index[order] = np.cumsum(is_new) - 1
    return points[order[is_new]], index.reshape(-1, 3)


def open_edges(corner: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Edges (n, 2) of triangles that are passed more often one way than the other, and how often more.

    corner: numbers of the corners of the triangles, (m, 3).
    """
    directed = np.concatenate([corner[:, [k, (k + 1) % 3]] for k in range(3)])
    low, high = directed.min(axis=1), directed.max(axis=1)
    count = int(corner.max(initial=0)) + 1
    keys, which = np.unique(low * count + high, return_inverse=True)
    ways = np.bincount(which, np.sign(directed[:, 1] - directed[:, 0]), keys.size).astype(np.int64)
    edges = np.stack(np.divmod(keys[ways != 0], count), axis=-1)
    return edges, ways[ways != 0]


def mended(triangles: NDArray[np.float64], distance: float) -> tuple[NDArray[np.float64], list[str]]:
    """The surface with fewer open edges, and what was done to it; holes stay.

    distance: within which open corners are one [m], along each axis.
    """
    points, corner = welded(triangles)
    edges, ways = open_edges(corner)
    left, done = _count(ways), list[str]()
    joined = _joined(points, np.unique(edges), distance)[corner]
    if (fewer := _count(open_edges(joined)[1])) < left:
        moved = UM_PER_M * np.abs(points[joined] - points[corner]).max()
        done.append(f"corners joined to others within {moved:.2g} µm: {np.unique(corner[joined != corner]).size:,}")
        left, corner = fewer, joined
    for kind, is_extra in (("without area", _is_flat), ("repeated", _is_repeated)):
        kept = corner[~is_extra(corner, points, distance)]
        if len(kept) and (fewer := _count(open_edges(kept)[1])) < left:
            done.append(f"triangles {kind} left out: {len(corner) - len(kept):,}")
            left, corner = fewer, kept
    return points[corner], done


def _count(ways: NDArray[np.int64]) -> int:
    return int(np.abs(ways).sum())


def _joined(points: FloatMap, found: NDArray[np.int64], distance: float) -> NDArray[np.int64]:
    """For each point the one that it is joined to; found: those that may be.

    Cells of twice the distance, shifted by half of one along each axis: any two near points share one of them. Decimals
    are never at the edge of one.
    """
    to = np.arange(len(points))
    for shift in product((0.25, 0.75), repeat=3):
        cells = np.floor(points[to[found]] / (2.0 * distance) + shift)
        _, first, which = np.unique(cells, axis=0, return_index=True, return_inverse=True)
        to[found] = to[found][first][which.ravel()]
    return to


def _is_flat(corner: NDArray[np.int64], points: FloatMap, distance: float) -> NDArray[np.bool_]:
    sides = points[corner] - points[np.roll(corner, 1, axis=1)]
    with np.errstate(over="ignore", invalid="ignore"):  # of coordinates that no part has
        longest = np.linalg.norm(sides, axis=2).max(axis=1)
        flat: NDArray[np.bool_] = np.linalg.norm(np.cross(sides[:, 1], sides[:, 2]), axis=1) <= distance * longest
    return flat


def _is_repeated(corner: NDArray[np.int64], *_: object) -> NDArray[np.bool_]:
    """Triangles that an earlier one repeats, the same way round."""
    first = corner.argmin(axis=1)[:, None]
    turned = np.take_along_axis(corner, (first + np.arange(3)) % 3, axis=1)
    repeated = np.ones(len(corner), np.bool_)
    repeated[np.unique(turned, axis=0, return_index=True)[1]] = False
    return repeated
