"""Closed surfaces of triangles, read from a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap, FloatMap


@dataclass(frozen=True, eq=False)
class Body:
    """Triangles with the names that the file gives them, "" for none.

    triangles: (n, 3 corners, x y z), counterclockwise from outside; in metres, or in the unit of the file. paint: names
    of the materials of its triangles where they have several; `material` is "" then. resolution: of the coordinates,
    as their file rounds them, in their unit.
    """

    triangles: NDArray[np.float64]
    name: str = ""
    material: str = ""
    paint: tuple[str, ...] = ()
    resolution: float = 0.0

    @property
    def volume(self) -> float:
        """Enclosed volume by the divergence theorem, below 0 for faces that point inwards; of a closed surface only."""
        corners = self.triangles - self.triangles.reshape(-1, 3).mean(axis=0)
        return float(np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))) / 6.0


def transformed(body: Body, matrix: FloatMap, shift: FloatMap) -> Body:
    """Every corner times a matrix (3, 3), plus a shift (3,); a mirrored body keeps its outside.

    Equal corners of two triangles stay equal to the last bit, which a matrix product of a library does not guarantee.
    """
    if (matrix == np.eye(3)).all() and not shift.any():
        return body
    x, y, z = np.moveaxis(body.triangles, -1, 0)
    corners = np.stack([row[0] * x + row[1] * y + row[2] * z + add for row, add in zip(matrix, shift, strict=True)], -1)
    if np.linalg.det(matrix) < 0.0:
        corners = corners[:, ::-1]
    return replace(body, triangles=corners, resolution=body.resolution * float(np.abs(matrix).sum(axis=1).max()))


def bounds(bodies: Sequence[Body]) -> tuple[FloatMap, FloatMap]:
    """Lowest and highest x, y, z of all bodies together."""
    axes = [[body.triangles[..., axis] for axis in range(3)] for body in bodies]  # ten times faster than all at once
    low, high = ([[end(values) for values in of_body] for of_body in axes] for end in (np.min, np.max))
    return np.min(low, axis=0), np.max(high, axis=0)


def walls_on_centers(bodies: Sequence[Body], pitch: float, tolerance: float = 1e-6) -> tuple[float, ...]:
    """Positions of upright walls along x or y that lie on a row of cell centres [m], ascending.

    Rounding of the coordinates decides there which side of the row is inside: within their resolution, or `tolerance`
    of a pitch where that is more.
    """
    found: set[float] = set()
    for body in bodies:
        near = max(tolerance, body.resolution / pitch)
        for axis in (0, 1):
            at = body.triangles[:, :, axis] / pitch
            is_wall: BoolMap = np.ptp(at, axis=1) <= near
            row = np.round(at[is_wall, 0])
            found |= {float(n) * pitch for n in np.unique(row[np.abs(at[is_wall, 0] - row) <= near])}
    return tuple(sorted(found))
