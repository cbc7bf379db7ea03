"""From fine pixels to cells: mean of the measured pixels in each cell, and the measured share of the cell."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap, FloatMap
from inkloop.errors import HeightMapError
from inkloop.metrology.height_map import HeightMap
from inkloop.metrology.registration import Registration
from inkloop.units import UM_PER_M

__all__ = ["cell_means"]

PIXELS_PER_CELL = 8  # coarser pixels are divided first: a turned pixel counts as an upright one of the same area
_BLOCK = 1 << 18  # pixels at a time, so that they stay in the processor's cache
_UPRIGHT = 1e-12  # rad: a rotation by quarter turns
_ROUNDING = 1e-6  # share of a cell that rounding gives to an adjacent pixel


@dataclass(frozen=True, eq=False)
class CellMeans:
    """mean: (nx, ny) mean measured height [m], NaN where nothing was; share: (nx, ny), measured part of each cell."""

    mean: FloatMap
    share: FloatMap

    def valid(self, share_min: float) -> BoolMap:
        """Cells of which at least `share_min` was measured."""
        return np.isfinite(self.mean) & (self.share >= share_min)


def cell_means(map_: HeightMap, registration: Registration, nx: int, ny: int, pitch: float) -> CellMeans:
    """The map on a grid of nx x ny cells of `pitch` [m].

    Every pixel is an upright box of its area around its centre, and gives each cell the part that lies in it; so the
    volume under the map is kept, and aligned pixels that divide a cell give its exact mean. Linear in pixels. Raises
    HeightMapError where a pixel is larger than a cell.
    """
    width, depth = _box(map_, registration)
    if max(width, depth) > pitch * (1.0 + _ROUNDING):
        raise HeightMapError(
            f"{map_.source}: a pixel is {max(width, depth) * UM_PER_M:.4g} µm on the grid, a cell "
            f"{pitch * UM_PER_M:.4g} µm; expected finer pixels than cells; check the size of the pixels"
        )
    is_upright = abs(math.remainder(registration.rotation, math.pi / 2)) < _UPRIGHT
    parts = 1 if is_upright else math.ceil(max(width, depth) * PIXELS_PER_CELL / pitch)
    bins = _Bins.empty(nx, ny, width / parts / pitch, depth / parts / pitch)
    for x, y, z in _blocks(map_, registration, parts):
        bins.add(x / pitch + 0.5, y / pitch + 0.5, z)
    return bins.means()


@dataclass(frozen=True, eq=False)
class _Bins:
    """Sums over the cells of a grid with a ring of cells around it, which collects pixels outside.

    volume, pixels: (nx + 2, ny + 2) sums of heights and of pixels; width, depth: of a pixel [cells].
    """

    volume: NDArray[np.float64]
    pixels: NDArray[np.float64]
    width: float
    depth: float

    @classmethod
    def empty(cls, nx: int, ny: int, width: float, depth: float) -> _Bins:
        return cls(np.zeros((nx + 2, ny + 2)), np.zeros((nx + 2, ny + 2)), width, depth)

    def add(self, x: FloatMap, y: FloatMap, z: FloatMap) -> None:
        """Pixels with heights, their centres in cells from the corner of cell (0, 0): each to up to four cells."""
        i, beyond_i = _split(x, self.width)
        j, beyond_j = _split(y, self.depth)
        self._add(i, j, z, (1.0 - beyond_i) * (1.0 - beyond_j))
        over_i, over_j = np.flatnonzero(beyond_i), np.flatnonzero(beyond_j)
        over_both = over_i[beyond_j[over_i] > 0.0]
        self._add(i[over_i] + 1, j[over_i], z[over_i], (beyond_i * (1.0 - beyond_j))[over_i])
        self._add(i[over_j], j[over_j] + 1, z[over_j], (beyond_j * (1.0 - beyond_i))[over_j])
        self._add(i[over_both] + 1, j[over_both] + 1, z[over_both], (beyond_i * beyond_j)[over_both])

    def means(self) -> CellMeans:
        """Means of the added pixels, by cell of the grid."""
        volume, pixels = self.volume[1:-1, 1:-1], self.pixels[1:-1, 1:-1]
        share = pixels * self.width * self.depth
        seen = share > _ROUNDING
        mean = np.divide(volume, pixels, out=np.full(volume.shape, np.nan), where=seen)
        return CellMeans(mean, np.minimum(np.where(seen, share, 0.0), 1.0))

    def _add(self, i: NDArray[np.intp], j: NDArray[np.intp], z: FloatMap, part: FloatMap) -> None:
        nx, ny = shape = self.volume.shape
        cells = np.clip(i + 1, 0, nx - 1) * ny + np.clip(j + 1, 0, ny - 1)
        self.volume[...] += np.bincount(cells, z * part, self.volume.size).reshape(shape)
        self.pixels[...] += np.bincount(cells, part, self.volume.size).reshape(shape)


def _split(center: FloatMap, size: float) -> tuple[NDArray[np.intp], FloatMap]:
    """Index of the cell in which a box begins, and the share of the box in the next one."""
    begin = center - 0.5 * size
    cell = np.floor(begin)
    return cell.astype(np.intp), np.maximum((begin + size - cell - 1.0) / size, 0.0)


def _box(map_: HeightMap, registration: Registration) -> tuple[float, float]:
    """Sides of a pixel along x and y of the grid [m]; a map turned on its side has them exchanged."""
    width, depth = map_.dx * registration.scale, map_.dy * registration.scale
    lies_on_side = abs(math.sin(registration.rotation)) > abs(math.cos(registration.rotation))
    return (depth, width) if lies_on_side else (width, depth)


def _blocks(map_: HeightMap, registration: Registration, parts: int) -> Iterator[tuple[FloatMap, FloatMap, FloatMap]]:
    """Some rows of pixels at a time, each divided into parts x parts: x, y on the grid and z [m] of those with z."""
    m, n = map_.shape
    inside = (np.arange(parts) + 0.5) / parts - 0.5
    y = map_.y0 + (np.arange(n)[:, None] + inside).ravel() * map_.dy
    rows = max(1, _BLOCK // (n * parts**2))
    for first in range(0, m, rows):
        z = map_.z[first : first + rows]
        x = map_.x0 + (np.arange(first, first + len(z))[:, None] + inside).ravel() * map_.dx
        if parts > 1:
            z = np.repeat(np.repeat(z, parts, axis=0), parts, axis=1)
        measured = np.isfinite(z)
        on_grid = registration.to_grid(x[:, None], y)
        yield on_grid[0][measured], on_grid[1][measured], z[measured]
