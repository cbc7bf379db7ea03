"""A height map on the grid of cells: its place, from numbers or fiducials, and the means of its pixels in each cell."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap, FloatMap
from inkloop.errors import HeightMapError
from inkloop.metrology.height_map import HeightMap, Mirror
from inkloop.units import UM_PER_M

__all__ = ["Registration", "cell_means"]

Points: TypeAlias = Sequence[Sequence[float]] | NDArray[np.float64]
FIDUCIALS_MIN = 2
MIRROR_SUSPECTED = 0.2  # share of the residual that the mirrored map must stay below (assumed)
PIXELS_PER_CELL = 8  # coarser pixels are divided first: a turned pixel counts as an upright one of the same area
_BLOCK = 1 << 18  # pixels at a time, so that they stay in the processor's cache
_UPRIGHT = 1e-12  # rad: a rotation by quarter turns
_ROUNDING = 1e-6  # share of a cell that rounding gives to an adjacent pixel


@dataclass(frozen=True)
class Registration:
    """Takes a point of the map to the grid: grid = offset + turn(mirror(point)).

    offset_x, offset_y: place of the map's origin on the grid [m], whose origin is the centre of cell (0, 0); rotation:
    of the map on the grid, counterclockwise from x to y [rad]; mirror: the map's coordinate that counts the other way
    ("y" for pictures, whose rows go down).
    """

    offset_x: float = 0.0
    offset_y: float = 0.0
    rotation: float = 0.0
    mirror: Mirror = "none"

    @property
    def matrix(self) -> NDArray[np.float64]:
        """(2, 2): matrix of a point before the shift."""
        cos, sin = math.cos(self.rotation), math.sin(self.rotation)
        return np.array([[cos, -sin], [sin, cos]]) * _signs(self.mirror)

    def to_grid(self, x: FloatMap, y: FloatMap) -> tuple[FloatMap, FloatMap]:
        """Points of the map on the grid [m]; x and y broadcast."""
        (a, b), (c, d) = self.matrix
        return self.offset_x + a * x + b * y, self.offset_y + c * x + d * y


def from_fiducials(on_map: Points, on_grid: Points, *, mirror: Mirror = "none", residual_max: float) -> Registration:
    """The rigid registration that brings two or more points of the map next to those of the grid (least squares).

    on_map, on_grid: (k, 2) [m], in one order; residual_max: a fit that leaves a larger root mean square distance [m] is
    refused. Raises HeightMapError. Umeyama 1991, eq. 40-42, in the plane.
    """
    source, target = np.array(on_map, np.float64), np.array(on_grid, np.float64)
    if source.shape != target.shape or source.ndim != 2 or source.shape[1] != 2 or len(source) < FIDUCIALS_MIN:
        raise HeightMapError(
            f"fiducials: {source.shape} on the map, {target.shape} on the grid; expected the same two or more points "
            "[x, y] on both"
        )
    if not (np.isfinite(source).all() and np.isfinite(target).all()):
        raise HeightMapError("fiducials: a coordinate is not finite; expected lengths")
    for points, place in ((source, "map"), (target, "grid")):
        if np.ptp(points, axis=0).max() == 0.0:
            raise HeightMapError(f"fiducials: all lie on one point of the {place}; expected at least two places")
    registration, residual = _rigid(source, target, mirror)
    if residual <= residual_max:
        return registration
    other: Mirror = "y" if mirror == "none" else "none"
    _, mirrored = _rigid(source, target, other)
    hint = "check that they are given in the same order and in the same unit"
    if mirrored < MIRROR_SUSPECTED * residual:
        hint = f"with mirror = {other!r} it is {mirrored * UM_PER_M:.3g} µm: the map is mirrored"
    raise HeightMapError(
        f"fiducials: the best fit leaves {residual * UM_PER_M:.3g} µm rms, {residual_max * UM_PER_M:.3g} µm are "
        f"allowed; {hint}"
    )


def _rigid(source: FloatMap, target: FloatMap, mirror: Mirror) -> tuple[Registration, float]:
    """Least squares, with points as complex numbers: target = offset + factor * source, |factor| = 1; and its rms."""
    u, v = (source * _signs(mirror)) @ [1, 1j], target @ [1, 1j]
    mean_u, mean_v = u.mean(), v.mean()
    product = np.vdot(u - mean_u, v - mean_v)
    factor = product / abs(product)
    offset = mean_v - factor * mean_u
    residual = float(np.sqrt(np.mean(np.abs(offset + factor * u - v) ** 2)))
    return Registration(float(offset.real), float(offset.imag), float(np.angle(factor)), mirror), residual


def _signs(mirror: Mirror) -> NDArray[np.float64]:
    return np.array([-1.0 if mirror == "x" else 1.0, -1.0 if mirror == "y" else 1.0])


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
    bins = _Bins(nx, ny, width / parts / pitch, depth / parts / pitch)
    for x, y, z in _blocks(map_, registration, parts):
        bins.add(x / pitch + 0.5, y / pitch + 0.5, z)
    return bins.means()


class _Bins:
    """Sums of heights and of pixels over the cells of a grid with a ring of cells around it, for pixels outside.

    width, depth: of a pixel [cells].
    """

    def __init__(self, nx: int, ny: int, width: float, depth: float) -> None:
        self._sums = np.zeros((2, nx + 2, ny + 2))
        self._width, self._depth = width, depth

    def add(self, x: FloatMap, y: FloatMap, z: FloatMap) -> None:
        """Pixels with heights, their centres in cells from the corner of cell (0, 0): each to up to four cells."""
        i, beyond_i = _split(x, self._width)
        j, beyond_j = _split(y, self._depth)
        self._add(i, j, z, (1.0 - beyond_i) * (1.0 - beyond_j))
        over_i, over_j = np.flatnonzero(beyond_i), np.flatnonzero(beyond_j)
        over_both = over_i[beyond_j[over_i] > 0.0]
        self._add(i[over_i] + 1, j[over_i], z[over_i], (beyond_i * (1.0 - beyond_j))[over_i])
        self._add(i[over_j], j[over_j] + 1, z[over_j], (beyond_j * (1.0 - beyond_i))[over_j])
        self._add(i[over_both] + 1, j[over_both] + 1, z[over_both], (beyond_i * beyond_j)[over_both])

    def means(self) -> CellMeans:
        """Means of the added pixels, by cell of the grid."""
        volume, pixels = self._sums[:, 1:-1, 1:-1]
        share = pixels * self._width * self._depth
        seen = share > _ROUNDING
        mean = np.divide(volume, pixels, out=np.full(volume.shape, np.nan), where=seen)
        return CellMeans(mean, np.minimum(np.where(seen, share, 0.0), 1.0))

    def _add(self, i: NDArray[np.intp], j: NDArray[np.intp], z: FloatMap, part: FloatMap) -> None:
        _, nx, ny = self._sums.shape
        cells = np.clip(i + 1, 0, nx - 1) * ny + np.clip(j + 1, 0, ny - 1)
        self._sums += [np.bincount(cells, each, nx * ny).reshape(nx, ny) for each in (z * part, part)]


def _split(center: FloatMap, size: float) -> tuple[NDArray[np.intp], FloatMap]:
    """Index of the cell in which a box begins, and the share of the box in the next one."""
    begin = center - 0.5 * size
    cell = np.floor(begin)
    return cell.astype(np.intp), np.maximum((begin + size - cell - 1.0) / size, 0.0)


def _box(map_: HeightMap, registration: Registration) -> tuple[float, float]:
    """Sides of a pixel along x and y of the grid [m]; a map turned on its side has them exchanged."""
    lies_on_side = abs(math.sin(registration.rotation)) > abs(math.cos(registration.rotation))
    return (map_.dy, map_.dx) if lies_on_side else (map_.dx, map_.dy)


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
