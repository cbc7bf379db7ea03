"""Space that the surfaces of bodies enclose: its columns, its box, its volume, its pieces."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap
from inkloop.geometry.body import Body, bounds
from inkloop.geometry.columns import Columns, check_grid
from inkloop.geometry.library import MeshReportStruct, intervals_by

FINE = 512
"""Columns along the longer side of bodies that overlap or are cut, where their box and their volume are asked for."""
SAMPLED_DIGITS = 3
"""Digits of a length and a volume that these columns tell: single ones are 0.2 % off."""


@dataclass(frozen=True, eq=False)
class MeshColumns:
    """Columns of a mesh, and columns that its surface leaves undecided.

    occupied: number of columns that meet the mesh. open_cells: i ny + j of those whose winding number is not 0 above
    the mesh, ascending, without intervals. inside_out: number of those with a winding number below 0 and none above 0;
    inside_out_cell: the first of them, -1 without any. overlap: what bodies that overlap hold more than their union
    [m3], as the columns see it.
    """

    columns: Columns
    occupied: int
    open_cells: NDArray[np.int64]
    inside_out: int
    inside_out_cell: int
    overlap: float


def mesh_columns(bodies: Sequence[Body], nx: int, ny: int, pitch: float) -> MeshColumns:
    """All bodies as one, also where they overlap, without regard to `cut`, cut off at the grid; in metres, finite."""
    check_grid(nx, ny, pitch)
    triangles = np.concatenate([np.empty((0, 3, 3)), *(body.triangles for body in bodies)])
    triangles /= (pitch, pitch, 1.0)
    open_cells = np.empty(nx * ny, dtype=np.int64)
    report = MeshReportStruct(open_cells.ctypes.data, open_cells.size)
    ends = intervals_by("columns_of_mesh", nx * ny, nx, ny, len(triangles), triangles, ctypes.byref(report))
    found = open_cells[: report.open_count].copy()
    columns = Columns(nx, ny, pitch, *ends)
    overlap = report.wound_height * pitch**2 - columns.volume
    return MeshColumns(columns, report.occupied, found, report.inside_out_count, report.inside_out_first, overlap)


def left_by_cuts(bodies: Sequence[Body], columns_of: Callable[[Sequence[Body], str], Columns]) -> Columns:
    """Columns of bodies, each without what is cut away from it.

    columns_of: some bodies without regard to `cut`, and what they are, "" for bodies of the part.
    """
    left = columns_of([body for body in bodies if not len(body.cut)], "")
    for body in bodies:
        if len(body.cut):
            left |= columns_of([body], "") - columns_of([Body(body.cut)], f", negative volume of {body.name!r}")
    return left


@dataclass(frozen=True, eq=False)
class Fine:
    """Bodies on FINE columns along the longer side of their box.

    low, high: the box of their triangles [m]; whole: without regard to `cut`; left: what cuts leave of it.
    """

    low: FloatMap
    high: FloatMap
    whole: MeshColumns
    left: Columns

    @classmethod
    def of(cls, bodies: Sequence[Body]) -> Fine:
        """Bodies in metres, wherever they are."""
        low, high = bounds(bodies)
        pitch = float((high - low)[:2].max()) / FINE
        nx, ny = (max(1, round(float(side) / pitch)) for side in (high - low)[:2])
        first = low + np.array([pitch / 2, pitch / 2, 0.0])
        moved = [replace(body, triangles=body.triangles - first, cut=body.cut - first) for body in bodies]
        whole = mesh_columns(moved, nx, ny, pitch)
        is_cut = any(len(body.cut) for body in bodies)
        left = (
            left_by_cuts(moved, lambda some, _: mesh_columns(some, nx, ny, pitch).columns) if is_cut else whole.columns
        )
        return cls(low, high, whole, left)

    @property
    def box(self) -> tuple[FloatMap, FloatMap]:
        """Lowest and highest x, y, z [m]: of the triangles, where no cut is seen to change it."""
        (low, high), (left_low, left_high) = (self._ends(each) for each in (self.whole.columns, self.left))
        return np.where(low == left_low, self.low, left_low), np.where(high == left_high, self.high, left_high)

    def _ends(self, columns: Columns) -> tuple[FloatMap, FloatMap]:
        if not columns.tops.size:
            return self.low, self.high
        i, j = np.divmod(columns.cells, columns.ny)
        low, high = ([end(i), end(j), end(z)] for end, z in ((np.min, columns.bottoms), (np.max, columns.tops)))
        scale = [columns.pitch, columns.pitch, 1.0]
        return self.low + np.multiply(low, scale), self.low + np.multiply(np.add(high, [1, 1, 0]), scale)


class Measured(NamedTuple):
    """Box and volume of bodies: lowest and highest x, y, z [m], volume [m3].

    box_is_sampled, volume_is_sampled: whether they come from FINE columns, which tell SAMPLED_DIGITS of them.
    """

    low: FloatMap
    high: FloatMap
    volume: float
    box_is_sampled: bool = False
    volume_is_sampled: bool = False


def measured(bodies: Sequence[Body], shared: bool = False) -> Measured:
    """Box and volume of what cuts leave of closed bodies; shared: whether they overlap.

    The share of all volume that is neither cut away nor counted twice is that of FINE columns.
    """
    whole = sum(body.volume for body in bodies)
    if not shared and not any(len(body.cut) for body in bodies):
        return Measured(*bounds(bodies), whole)
    fine = Fine.of(bodies)
    counted = fine.whole.columns.volume + fine.whole.overlap
    volume, box = whole * fine.left.volume / counted if counted else 0.0, fine.box
    return Measured(*box, volume, not np.array_equal(box, (fine.low, fine.high)), True)
