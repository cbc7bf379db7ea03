"""A part as columns: the intervals of height that it fills over the centre of every cell.

An interval is half open, bottom <= z < top, so that two regions which share a face neither share a point nor leave one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap, FloatMap, Geometry, HeightIntervals
from inkloop.geometry.cells import cell_centers, cell_index

Rule: TypeAlias = Callable[[NDArray[np.bool_]], BoolMap]


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
        cell, bottom, top = (np.ravel(values) for values in (cell, bottom, top))
        keep = bottom < top
        cell, bottom, top = cell[keep], bottom[keep], top[keep]
        steps = np.repeat(np.array([[1], [-1]]), cell.size, axis=0)
        return _where(nx, ny, pitch, np.tile(cell, 2), np.concatenate([bottom, top]), steps, _any)

    @classmethod
    def of_shape(cls, shape: Geometry, nx: int, ny: int, pitch: float) -> Columns:
        """What a shape fills over the centres of the cells; points of its closed skin stay part of it."""
        intervals = [np.broadcast_arrays(*ends) for ends in shape.intervals(*cell_centers(nx, ny, pitch))]
        cell = np.tile(np.arange(nx * ny), len(intervals))
        bottom, top = (np.concatenate([[], *(np.ravel(ends[side]) for ends in intervals)]) for side in (0, 1))
        return cls.of_intervals(nx, ny, pitch, cell, bottom, np.where(bottom <= top, np.nextafter(top, np.inf), bottom))

    @property
    def counts(self) -> NDArray[np.int64]:
        """Number of intervals of each cell, (nx, ny)."""
        counts: NDArray[np.int64] = np.diff(self.offsets).reshape(self.nx, self.ny)
        return counts

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
        cell, z = np.broadcast_arrays(self._cell(x, y), z)
        first, count = self._span(cell)
        inside = np.zeros(cell.shape, dtype=np.bool_)
        for k in range(int(count.max(initial=0))):
            inside |= (self._taken(self.bottoms, first + k, count > k, np.inf) <= z) & (
                z < self._taken(self.tops, first + k, count > k, -np.inf)
            )
        return inside

    def inside(self, z: FloatMap) -> BoolMap:
        """True where the height z of each cell, (nx, ny) [m], lies in one of its intervals."""
        return self.contains(*cell_centers(self.nx, self.ny, self.pitch), z)

    def intervals(self, x: FloatMap, y: FloatMap) -> HeightIntervals:
        """Closed intervals of the same points over the nearest cell [m], the lowest first, as many as a cell has at most."""
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
        return self._combined(other, _any)

    def __and__(self, other: Columns) -> Columns:
        """The points of both."""
        return self._combined(other, lambda inside: inside.all(axis=1))

    def __sub__(self, other: Columns) -> Columns:
        """The points of these columns that the others lack."""
        return self._combined(other, lambda inside: inside[:, 0] & ~inside[:, 1])

    def _combined(self, other: Columns, rule: Rule) -> Columns:
        for name in ("nx", "ny", "pitch"):
            if getattr(self, name) != getattr(other, name):
                raise ValueError(
                    f"{name} of the columns is {getattr(self, name)} and {getattr(other, name)}; needs one grid"
                )
        parts = (self, other)
        cell = np.concatenate(
            [np.tile(np.repeat(np.arange(self.nx * self.ny), part.counts.ravel()), 2) for part in parts]
        )
        z = np.concatenate([ends for part in parts for ends in (part.bottoms, part.tops)])
        steps = np.zeros((cell.size, 2), dtype=np.int64)
        half = 2 * self.bottoms.size
        steps[:half, 0] = np.repeat([1, -1], self.bottoms.size)
        steps[half:, 1] = np.repeat([1, -1], other.bottoms.size)
        return _where(self.nx, self.ny, self.pitch, cell, z, steps, rule)

    def _cell(self, x: FloatMap, y: FloatMap) -> NDArray[np.int64]:
        return cell_index(x, y, self.nx, self.ny, self.pitch)

    def _span(self, cell: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """First interval of each cell and their number; none outside the grid."""
        first = self.offsets[cell]
        return first, np.where(cell >= 0, self.offsets[cell + 1] - first, 0)

    def _taken(self, ends: FloatMap, at: NDArray[np.int64], is_there: BoolMap, otherwise: float) -> FloatMap:
        values = np.full(at.shape, otherwise)
        values[is_there] = ends[at[is_there]]
        return values


def _any(inside: NDArray[np.bool_]) -> BoolMap:
    found: BoolMap = inside.any(axis=1)
    return found


def _where(
    nx: int, ny: int, pitch: float, cell: NDArray[Any], z: FloatMap, steps: NDArray[np.int64], rule: Rule
) -> Columns:
    """Columns where `rule` holds of the marks "winding number above 0", which change by `steps` at z of `cell`."""
    order = np.lexsort((z, cell))
    cell, z, winding = cell[order], z[order], np.cumsum(steps[order], axis=0)
    is_last = np.ones(cell.size, dtype=np.bool_)  # of the changes at one height
    is_last[:-1] = (cell[1:] != cell[:-1]) | (z[1:] != z[:-1])
    cell, z, holds = cell[is_last], z[is_last], rule(winding[is_last] > 0)
    before = np.concatenate([[False], holds[:-1]])  # every column ends with False
    begins, ends = holds & ~before, before & ~holds
    offsets = np.concatenate([[0], np.cumsum(np.bincount(cell[begins], minlength=nx * ny))])
    return Columns(nx, ny, pitch, offsets, z[begins], z[ends])


def _check(columns: Columns) -> None:
    offsets, bottoms, tops = columns.offsets, columns.bottoms, columns.tops
    if columns.nx < 1 or columns.ny < 1 or not columns.pitch > 0.0:
        raise ValueError(f"columns of {columns.nx} x {columns.ny} cells of {columns.pitch} m; needs lengths above 0")
    if offsets.shape != (columns.nx * columns.ny + 1,) or bottoms.ndim != 1 or bottoms.shape != tops.shape:
        raise ValueError(
            f"offsets of shape {offsets.shape}, bottoms {bottoms.shape}, tops {tops.shape}; "
            f"needs ({columns.nx * columns.ny + 1},) and two of one length"
        )
    if offsets[0] != 0 or offsets[-1] != bottoms.size or np.any(np.diff(offsets) < 0):
        raise ValueError(f"offsets do not ascend from 0 to the {bottoms.size} intervals")
    is_next = np.ones(bottoms.size + 1, dtype=np.bool_)
    is_next[offsets] = False
    is_wrong = ~(bottoms < tops)
    is_wrong[1:] |= is_next[1:-1] & ~(tops[:-1] < bottoms[1:])
    if is_wrong.any():
        cell = int(np.searchsorted(offsets, np.argmax(is_wrong), side="right")) - 1
        i, j = divmod(cell, columns.ny)
        raise ValueError(
            f"intervals of cell ({i}, {j}) do not ascend: needs bottom < top, and a gap to the next bottom"
        )
