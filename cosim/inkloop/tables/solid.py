"""Result of a `[part]` table: a shape on the grid, its region of ink A, and its bounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from inkloop.geometry import Columns, Shape


class Bounds(NamedTuple):
    """The box around a part in the plane [m], in coordinates of the grid."""

    x_min: float
    x_max: float
    y_min: float
    y_max: float


@dataclass(frozen=True, eq=False)
class Solid:
    """A part on the grid of a scenario.

    region: region of ink A, None: everywhere; remarks: notes for the user, one sentence each.
    """

    shape: Shape
    bounds: Bounds
    region: Columns | None = None
    remarks: tuple[str, ...] = ()

    def columns(self, nx: int, ny: int, pitch: float) -> Columns:
        """The shape over the cells of the grid; columns are taken as they are."""
        return self.shape if isinstance(self.shape, Columns) else Columns.of_shape(self.shape, nx, ny, pitch)


class PartError(Exception):
    """A part that cannot be made; `errors` holds one sentence each, with the key of `[part]` in front."""

    def __init__(self, errors: Sequence[str]) -> None:
        self.errors = tuple(errors)
        super().__init__("; ".join(self.errors))


def nothing(nx: int, ny: int, pitch: float) -> Columns:
    """No material on any cell."""
    return Columns(nx, ny, pitch, np.zeros(nx * ny + 1, np.int64), np.zeros(0), np.zeros(0))
