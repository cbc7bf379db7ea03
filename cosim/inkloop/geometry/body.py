"""Closed surfaces of triangles, read from a file, and their placement on the grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import cos, radians, sin
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap, FloatMap


@dataclass(frozen=True, eq=False)
class Body:
    """Triangles with the names that the file gives them, "" for none.

    triangles: (n, 3 corners, x y z), counterclockwise from outside; in metres, or in the unit of the file. paint: names
    of the materials of its triangles where they have several; `material` is "" then. resolution: of the coordinates,
    as their file rounds them, in their unit. cut: triangles of closed surfaces whose inside is not part of it. remarks:
    what was mended or left out, one sentence each.
    """

    triangles: NDArray[np.float64]
    name: str = ""
    material: str = ""
    paint: tuple[str, ...] = ()
    resolution: float = 0.0
    cut: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3, 3)))
    remarks: tuple[str, ...] = ()

    @property
    def volume(self) -> float:
        """Enclosed volume by the divergence theorem, below 0 for faces that point inwards; of a closed surface only.

        Without regard to `cut`.
        """
        corners = self.triangles - self.triangles.reshape(-1, 3).mean(axis=0)
        return float(np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))) / 6.0


def transformed(body: Body, matrix: FloatMap, shift: FloatMap) -> Body:
    """Every corner times a matrix (3, 3), plus a shift (3,); a mirrored body keeps its outside.

    Equal corners of two triangles stay equal to the last bit, which a matrix product of a library does not guarantee.
    """
    if (matrix == np.eye(3)).all() and not shift.any():
        return body
    resolution = body.resolution * float(np.abs(matrix).sum(axis=1).max())
    triangles, cut = (_moved(triangles, matrix, shift) for triangles in (body.triangles, body.cut))
    return replace(body, triangles=triangles, cut=cut, resolution=resolution)


def _moved(triangles: NDArray[np.float64], matrix: FloatMap, shift: FloatMap) -> NDArray[np.float64]:
    x, y, z = np.moveaxis(triangles, -1, 0)
    corners = np.stack([row[0] * x + row[1] * y + row[2] * z + add for row, add in zip(matrix, shift, strict=True)], -1)
    return corners[:, ::-1] if np.linalg.det(matrix) < 0.0 else corners


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


@dataclass(frozen=True)
class Placement:
    """Transform from the coordinates of a file to those of the grid: mirror, scale, rotate, place.

    place: "on-substrate": middle of the bounding box at `position`, lowest point at z = 0; "as-is": coordinates of the
    file, with the origin at the centre of cell (0, 0). mirror: the coordinates whose sign changes, of "xyz". scale:
    factor above 0. rotate_deg: about x, then y, then z, counterclockwise seen against the axis. position: (x, y) [m],
    default the middle of the grid. Raises ValueError with all errors.
    """

    place: Literal["on-substrate", "as-is"] = "on-substrate"
    rotate_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    scale: float = 1.0
    mirror: str = ""
    position: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        errors = []
        if self.place not in ("on-substrate", "as-is"):
            errors.append(f"place is {self.place!r}; expected on-substrate or as-is")
        if len(self.rotate_deg) != 3 or not np.isfinite(self.rotate_deg).all():
            errors.append(f"rotate_deg is {self.rotate_deg}; expected three angles")
        if not 0.0 < self.scale < np.inf:
            errors.append(f"scale is {self.scale}; expected a factor above 0")
        if not set(self.mirror) <= set("xyz") or len(set(self.mirror)) != len(self.mirror):
            errors.append(f"mirror is {self.mirror!r}; expected some of x, y and z")
        if self.position is not None and (len(self.position) != 2 or not np.isfinite(self.position).all()):
            errors.append(f"position is {self.position}; expected x and y")
        if self.position is not None and self.place == "as-is":
            errors.append("position is given, but place is as-is, which moves nothing; leave one of them out")
        if errors:
            raise ValueError("; ".join(errors))

    @property
    def matrix(self) -> FloatMap:
        """Mirror, scale and rotation, (3, 3)."""
        mirror = np.diag([-self.scale if axis in self.mirror else self.scale for axis in "xyz"])
        about_x, about_y, about_z = (_rotation(axis, angle) for axis, angle in enumerate(self.rotate_deg))
        matrix: FloatMap = about_z @ about_y @ about_x @ mirror
        return matrix

    def placed(self, bodies: Sequence[Body], nx: int, ny: int, pitch: float) -> tuple[Body, ...]:
        """The bodies on the grid, all moved alike."""
        turned = [transformed(body, self.matrix, np.zeros(3)) for body in bodies]
        if self.place == "as-is":
            return tuple(turned)
        low, high = bounds(turned)
        x, y = self.position or ((nx - 1) / 2 * pitch, (ny - 1) / 2 * pitch)
        shift = np.array([x - (low[0] + high[0]) / 2, y - (low[1] + high[1]) / 2, -low[2]])
        return tuple(replace(body, triangles=body.triangles + shift, cut=body.cut + shift) for body in turned)


def _rotation(axis: int, angle_deg: float) -> FloatMap:
    """About an axis; exact for multiples of 90 degrees, so that upright walls stay upright."""
    quarters, rest = divmod(angle_deg, 90.0)
    c, s = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[int(quarters) % 4]
    if rest:
        c, s = cos(radians(angle_deg)), sin(radians(angle_deg))
    matrix = np.eye(3)
    one, other = (axis + 1) % 3, (axis + 2) % 3
    matrix[one, one], matrix[one, other], matrix[other, one], matrix[other, other] = c, -s, s, c
    return matrix
