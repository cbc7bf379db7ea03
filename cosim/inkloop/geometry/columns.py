"""A part as columns: the intervals of height that it fills over the centre of every cell.

An interval is half open, bottom <= z < top, so that two regions which share a face neither share a point nor leave one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap, FloatMap, Geometry, HeightIntervals
from inkloop.geometry.library import ColumnsStruct, intervals_by, library

_OF_FIRST, _OF_SECOND, _OF_BOTH = 1, 2, 4  # POINTS_OF_... of column_algebra.h


def check_grid(nx: int, ny: int, pitch: float) -> None:
    """Raises ValueError for a grid without cells or size."""
    if nx < 1 or ny < 1 or not 0.0 < pitch < np.inf:
        raise ValueError(f"a grid of {nx} x {ny} cells of {pitch} m; needs at least one and a length above 0")


def cell_centers(nx: int, ny: int, pitch: float) -> tuple[FloatMap, FloatMap]:
    """x and y of every cell, each (nx, ny) [m]."""
    x, y = np.meshgrid(np.arange(nx) * pitch, np.arange(ny) * pitch, indexing="ij")
    return x, y


def _cell_index(x: FloatMap, y: FloatMap, nx: int, ny: int, pitch: float) -> NDArray[np.int64]:
    """i * ny + j of the cell with the nearest centre, -1 outside the grid; a point between two centres is in the upper.

    x, y: [m], broadcast against each other.
    """
    i, j = np.floor(np.asarray(x) / pitch + 0.5), np.floor(np.asarray(y) / pitch + 0.5)
    is_on_grid = (i >= 0) & (i < nx) & (j >= 0) & (j < ny)  # False for NaN
    index: NDArray[np.int64] = np.where(is_on_grid, i * ny + j, -1.0).astype(np.int64)
    return index


@dataclass(frozen=True, eq=False)
class Columns:
    """Intervals of height over every cell; fulfils `Geometry` and `Shape`.

    Cell (i, j), with its centre at (i pitch, j pitch) [m], has the intervals from offsets[i ny + j] up to and without
    offsets[i ny + j + 1]: bottoms <= z < tops [m], ascending, with a gap between two of them. The arrays are read-only.
    Raises ValueError for anything else.
    """

    nx: int
    ny: int
    pitch: float
    offsets: NDArray[np.int64]
    bottoms: NDArray[np.float64]
    tops: NDArray[np.float64]

    def __post_init__(self) -> None:
        for name, dtype in (("offsets", np.int64), ("bottoms", np.float64), ("tops", np.float64)):
            array = np.ascontiguousarray(getattr(self, name), dtype=dtype).view()
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        _check(self)

    @classmethod
    def of_intervals(
        cls, nx: int, ny: int, pitch: float, cell: NDArray[Any], bottom: NDArray[Any], top: NDArray[Any]
    ) -> Columns:
        """The union of intervals in any order; those with their bottom not below their top are empty.

        cell: i ny + j of each interval; bottom, top: bottom <= z < top [m]; three arrays of one size.
        """
        ends = [np.ascontiguousarray(np.ravel(values), dtype=np.float64) for values in (bottom, top)]
        cells = np.ascontiguousarray(np.ravel(cell), dtype=np.int64)
        if not cells.size == ends[0].size == ends[1].size:
            raise ValueError(f"{cells.size} cells, {ends[0].size} bottoms, {ends[1].size} tops; needs one of each")
        if cells.size and not 0 <= cells.min() <= cells.max() < nx * ny:
            raise ValueError(f"cells are {cells.min()} to {cells.max()}; needs 0 to {nx * ny - 1}")
        return cls(nx, ny, pitch, *intervals_by("columns_union", nx * ny, nx * ny, cells.size, cells, *ends))

    @classmethod
    def of_shape(cls, shape: Geometry, nx: int, ny: int, pitch: float) -> Columns:
        """Columns of a shape over the centres of the cells; points of its closed surface stay part of it."""
        if isinstance(shape, Columns) and (shape.nx, shape.ny, shape.pitch) == (nx, ny, pitch):
            return shape
        columns = None
        for bottom, top in shape.intervals(*cell_centers(nx, ny, pitch)):
            is_filled = np.ravel(bottom <= top)
            ends = np.ravel(bottom)[is_filled], np.nextafter(np.ravel(top)[is_filled], np.inf)
            further = cls.of_intervals(nx, ny, pitch, np.flatnonzero(is_filled), *ends)
            columns = further if columns is None else columns | further
        return columns or cls.of_intervals(nx, ny, pitch, np.empty(0), np.empty(0), np.empty(0))

    @property
    def counts(self) -> NDArray[np.int64]:
        """Number of intervals of each cell, (nx, ny)."""
        counts: NDArray[np.int64] = np.diff(self.offsets).reshape(self.nx, self.ny)
        return counts

    @property
    def cells(self) -> NDArray[np.int64]:
        """The cell of each interval, i ny + j."""
        return np.repeat(np.arange(self.nx * self.ny), self.counts.ravel())

    @property
    def mask(self) -> BoolMap:
        """True for cells with any interval, (nx, ny)."""
        return self.counts > 0

    @property
    def height(self) -> float:
        """Height of the highest point over the substrate [m]; 0 where there is none."""
        return float(self.tops.max(initial=0.0))

    @property
    def volume(self) -> float:
        """Filled height times pitch^2, summed over the cells [m3]."""
        return float((self.tops - self.bottoms).sum()) * self.pitch**2

    def contains(self, x: FloatMap, y: FloatMap, z: FloatMap) -> BoolMap:
        """True where z lies in an interval of the cell with the centre nearest to (x, y) [m]."""
        return self._contained(*np.broadcast_arrays(self._cell(x, y), z))

    def inside(self, z: FloatMap) -> BoolMap:
        """True where the height z of each cell, (nx, ny) [m], lies in one of its intervals."""
        if np.shape(z) != (self.nx, self.ny):
            raise ValueError(f"z has shape {np.shape(z)}; needs {(self.nx, self.ny)}")
        return self._contained(None, z)

    def intervals(self, x: FloatMap, y: FloatMap) -> HeightIntervals:
        """Closed intervals of the same points over the nearest cell [m], lowest first, as many as any has."""
        first, count = self._span(self._cell(x, y))
        return [
            (
                self._taken(self.bottoms, first + k, count > k, np.inf),
                np.nextafter(self._taken(self.tops, first + k, count > k, -np.inf), -np.inf),
            )
            for k in range(int(count.max(initial=0)))
        ]

    def top(self, x: FloatMap, y: FloatMap) -> FloatMap:
        """Highest point over the nearest cell [m]; 0 where there is none."""
        first, count = self._span(self._cell(x, y))
        return self._taken(self.tops, first + count - 1, count > 0, 0.0)

    def __or__(self, other: Columns) -> Columns:
        """The union. Raises ValueError for columns on another grid, as `&` and `-`."""
        return self._combined(other, _OF_FIRST | _OF_SECOND | _OF_BOTH)

    def __and__(self, other: Columns) -> Columns:
        """The points of both."""
        return self._combined(other, _OF_BOTH)

    def __sub__(self, other: Columns) -> Columns:
        """The points of these columns that the others lack."""
        return self._combined(other, _OF_FIRST)

    def _combined(self, other: Columns, rule: int) -> Columns:
        grids = [(part.nx, part.ny, part.pitch) for part in (self, other)]
        if grids[0] != grids[1]:
            raise ValueError(f"columns have grids of {grids[0]} and {grids[1]} (nx, ny, pitch); needs one grid")
        cells = self.nx * self.ny
        return Columns(*grids[0], *intervals_by("columns_combine", cells, cells, self._struct, other._struct, rule))

    @property
    def _struct(self) -> ColumnsStruct:
        return ColumnsStruct.of(self.offsets, self.bottoms, self.tops)

    def _contained(self, cell: NDArray[np.int64] | None, z: FloatMap) -> BoolMap:
        heights = np.ascontiguousarray(z, dtype=np.float64)
        cells = None if cell is None else np.ascontiguousarray(cell)
        inside = np.empty(heights.shape, dtype=np.bool_)
        at = None if cells is None else cells.ctypes.data
        library().columns_inside(self._struct, heights.size, at, heights, inside)
        return inside

    def _cell(self, x: FloatMap, y: FloatMap) -> NDArray[np.int64]:
        return _cell_index(x, y, self.nx, self.ny, self.pitch)

    def _span(self, cell: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """First interval of each cell and the number of its intervals; none outside the grid."""
        first = self.offsets[cell]
        return first, np.where(cell >= 0, self.offsets[cell + 1] - first, 0)

    def _taken(self, ends: FloatMap, at: NDArray[np.int64], is_there: BoolMap, otherwise: float) -> FloatMap:
        values = np.full(at.shape, otherwise)
        values[is_there] = ends[at[is_there]]
        return values


def _check(columns: Columns) -> None:
    nx, ny, offsets, bottoms, tops = columns.nx, columns.ny, columns.offsets, columns.bottoms, columns.tops
    check_grid(nx, ny, columns.pitch)
    shapes = offsets.shape, bottoms.shape, tops.shape
    if shapes != ((nx * ny + 1,), (bottoms.size,), (bottoms.size,)):
        raise ValueError(
            f"offsets, bottoms and tops have shapes {shapes}; needs ({nx * ny + 1},) and two of one length"
        )
    cell = library().columns_check(nx * ny, bottoms.size, columns._struct)
    if cell >= 0:
        raise ValueError(
            f"cell {divmod(cell, ny)}: its offsets do not ascend from 0 to {bottoms.size}, or its intervals do not "
            "ascend; needs bottom < top, and a gap to the next bottom"
        )
