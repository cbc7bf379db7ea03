"""Holes of a mesh: chains of edges that the triangles do not close."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap
from inkloop.geometry.body import Body


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
    corners, index = np.unique(
        np.concatenate([body.triangles for body in bodies]).reshape(-1, 3), axis=0, return_inverse=True
    )
    index = index.reshape(-1, 3)
    directed = np.concatenate([index[:, [k, (k + 1) % 3]] for k in range(3)])
    edges, which = np.unique(np.sort(directed, axis=1), axis=0, return_inverse=True)
    ways = np.bincount(which.ravel(), np.where(directed[:, 0] < directed[:, 1], 1.0, -1.0), len(edges))
    is_edge = edges[:, 0] != edges[:, 1]
    rims = {False: is_edge & (ways % 2 == 1), True: is_edge & (ways % 2 == 0) & (ways != 0.0)}
    found = [hole for is_seam, rim in rims.items() for hole in _chains(corners, edges[rim], is_seam)]
    return sorted(found, key=lambda hole: -hole.size)


def _chains(corners: FloatMap, rim: NDArray[np.int64], is_seam: bool) -> Iterator[Hole]:
    """Edges by connected component; rim: indices of their two corners (n, 2)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    if not len(rim):
        return
    used, ends = np.unique(rim, return_inverse=True)
    ends = ends.reshape(-1, 2)
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(used.size, used.size))
    count, labels = connected_components(graph, directed=False)
    for number in range(count):
        points = corners[used[labels == number]]
        low, high = points.min(axis=0), points.max(axis=0)
        x, y, z = (float(value) for value in (low + high) / 2)
        edges = int((labels[ends[:, 0]] == number).sum())
        yield Hole(edges, (x, y, z), float(np.linalg.norm(high - low)), is_seam)
