"""Placement of a part from a file: mirrored, scaled and turned, then on the middle of the grid or as in the file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos, radians, sin
from typing import Literal

import numpy as np

from inkloop.component import FloatMap
from inkloop.geometry.body import Body, bounds, transformed


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
        return tuple(replace(body, triangles=body.triangles + shift) for body in turned)


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
