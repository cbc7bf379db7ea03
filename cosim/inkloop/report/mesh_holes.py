"""Holes of a mesh: chains of edges that the triangles do not close."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from inkloop.geometry.body import Body


@dataclass(frozen=True)
class Hole:
    """Edges that hang together: their number, the middle of the box around them [m], and its diagonal [m]."""

    edges: int
    center: tuple[float, float, float]
    size: float


def holes(bodies: Sequence[Body]) -> list[Hole]:
    """All holes, the largest first; none of a watertight mesh, also where bodies touch or overlap."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    corners, index = np.unique(
        np.concatenate([body.triangles for body in bodies]).reshape(-1, 3), axis=0, return_inverse=True
    )
    index = index.reshape(-1, 3)
    directed = np.concatenate([index[:, [k, (k + 1) % 3]] for k in range(3)])
    edges, which = np.unique(np.sort(directed, axis=1), axis=0, return_inverse=True)
    ways = np.bincount(which.ravel(), np.where(directed[:, 0] < directed[:, 1], 1.0, -1.0), len(edges))
    rim = edges[(ways != 0.0) & (edges[:, 0] != edges[:, 1])]
    if not len(rim):
        return []
    used, ends = np.unique(rim, return_inverse=True)
    ends = ends.reshape(-1, 2)
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(used.size, used.size))
    count, labels = connected_components(graph, directed=False)
    found = []
    for number in range(count):
        points = corners[used[labels == number]]
        low, high = points.min(axis=0), points.max(axis=0)
        x, y, z = (float(value) for value in (low + high) / 2)
        found.append(Hole(int((labels[ends[:, 0]] == number).sum()), (x, y, z), float(np.linalg.norm(high - low))))
    return sorted(found, key=lambda hole: -hole.size)
