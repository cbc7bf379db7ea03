"""Registration by relief: the shift and rotation under which a map fits a known surface best.

The model of the map is a * surface + plane, so that neither the height of the layers nor the tilt and level of the
profiler need be known; the fit depends on the position of the surface's edges.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap, FloatMap
from inkloop.errors import HeightMapError
from inkloop.metrology.height_map import HeightMap
from inkloop.metrology.registration import Registration
from inkloop.units import UM_PER_M

EXPLAINED_MIN = 0.5
"""Share of the relief that the known surface has to explain (assumed)."""
POINTS_PER_CELL = 4  # along x and along y, in the fine fit
SEARCH_POINTS_MAX, FIT_POINTS_MAX = 4_000, 20_000  # of larger maps every so many-th point is used
SOFTNESS = (0.0, 0.15, 0.3)  # standard deviations of soft flanks in cells: the best fit is chosen
ROTATION_STEPS = 5  # rotations tried in the search, within its reach
CLIP = 4.0  # distance in standard deviations beyond which a point is left out: dust, spikes (assumed)
_NORMAL = 1.4826  # standard deviation of a normal distribution over its median absolute deviation
_ROUNDS = 3

Move: TypeAlias = NDArray[np.float64]
"""(3,): shift along x and y [m] and rotation [rad] about the middle of the map, added to the start registration."""


@dataclass(frozen=True)
class SurfaceFit:
    """residual: rms of the relief less the known surface [m]; explained: share of the relief's variance.

    offset_std: standard deviation of the shift [m].
    """

    registration: Registration
    residual: float
    explained: float
    offset_std: float


def fit_to_surface(
    map_: HeightMap,
    surface: FloatMap,
    pitch: float,
    start: Registration,
    *,
    reach: float,
    rotation_reach: float = 0.0,
) -> SurfaceFit:
    """The registration near `start` that explains most of the map's relief by a known surface (robust least squares).

    surface: (nx, ny) [m] or any relief in proportion to it, such as the mask of the part; reach: largest distance of
    the map from its place by `start`, along x and y [m]; rotation_reach: largest rotation [rad]. Raises HeightMapError
    where less than `EXPLAINED_MIN` is explained, or the best place is at the edge of what was searched.
    """
    if np.ptp(surface) == 0.0:
        raise HeightMapError(f"{map_.source}: the known surface is flat, so the position of the map is undetermined")
    coarse = _Relief.of(map_, surface, pitch, start, 1, SEARCH_POINTS_MAX)
    shifts = np.arange(-math.ceil(2 * reach / pitch), math.ceil(2 * reach / pitch) + 1) * pitch / 2
    turns = np.linspace(-rotation_reach, rotation_reach, ROTATION_STEPS if rotation_reach > 0.0 else 1)
    moves = [np.array((u, v, turn)) for turn in turns for u in shifts for v in shifts]
    best = min(moves, key=lambda move: float(np.sum(coarse.residuals(move) ** 2)))
    points = _Relief.of(map_, surface, pitch, start, POINTS_PER_CELL, FIT_POINTS_MAX)
    fits = [(fine := points.softened(width), _refined(fine, best, pitch, rotation_reach > 0.0)) for width in SOFTNESS]
    fine, move = min(fits, key=lambda fit: float(np.sum(fit[0].residuals(fit[1]) ** 2)))
    residuals = fine.residuals(move)
    explained = 1.0 - float(np.sum(residuals**2) / max(np.sum(fine.relief**2), np.finfo(np.float64).tiny))
    rms = float(np.sqrt(np.mean(residuals**2)))
    if explained < EXPLAINED_MIN or fine.gain(move) <= 0.0:
        raise HeightMapError(
            f"{map_.source}: the part explains {max(explained, 0.0):.0%} of its relief and leaves "
            f"{rms * UM_PER_M:.3g} µm rms; needs {EXPLAINED_MIN:.0%}: check offset, rotation, mirror and pixel size, "
            "or give fiducials"
        )
    if max(abs(move[0]), abs(move[1])) > reach or abs(move[2]) > rotation_reach * 1.2 + 1e-12:
        raise HeightMapError(
            f"{map_.source}: the part seems to lie {move[0] * UM_PER_M:.0f}, {move[1] * UM_PER_M:.0f} µm and "
            f"{math.degrees(move[2]):.2f} deg from the given registration; beyond what is searched: correct "
            "offset and rotation, or search wider"
        )
    count = 3 if rotation_reach > 0.0 else 2
    deviations = rms * np.sqrt(np.diag(np.linalg.pinv(_normal(fine, move, pitch)[:count, :count])))
    return SurfaceFit(fine.registration(move), rms, explained, float(deviations[:2].max()) * pitch)


@dataclass(frozen=True, eq=False)
class _Relief:
    """The map in points on the grid, less its plane, and the known surface to compare it with.

    x, y: (k,) as `start` puts them [m]; relief: (k,) [m]; plane: (k, 3) orthonormal columns; surface: each cell in
    per_cell x per_cell points, so that the ramp between two cells is as wide as a point of the map.
    """

    x: FloatMap
    y: FloatMap
    relief: FloatMap
    plane: FloatMap
    surface: FloatMap
    per_cell: int
    pitch: float
    start: Registration
    middle: tuple[float, float]

    @classmethod
    def of(
        cls, map_: HeightMap, surface: FloatMap, pitch: float, start: Registration, per_cell: int, points_max: int
    ) -> _Relief:
        x, y, z = _points(map_, pitch / per_cell)
        every = max(1, -(-z.size // points_max))
        x, y, z = x[::every], y[::every], z[::every]
        if z.size < 4 * 3:
            raise HeightMapError(
                f"{map_.source}: {z.size} places were measured; too few to find the position of the map"
            )
        x, y = start.to_grid(x, y)
        reach = max(np.ptp(x), np.ptp(y), pitch)
        plane, _ = np.linalg.qr(np.stack([np.ones_like(x), (x - x.mean()) / reach, (y - y.mean()) / reach], axis=1))
        relief = z - plane @ (plane.T @ z)
        points = np.repeat(np.repeat(np.asarray(surface, np.float64), per_cell, axis=0), per_cell, axis=1)
        middle = float(x.mean()), float(y.mean())
        return cls(x, y, relief, plane, points, per_cell, pitch, start, middle)

    @property
    def radius(self) -> float:
        """Half the width of the map [m]."""
        return max(float(np.ptp(self.x)), float(np.ptp(self.y))) / 2

    def without(self, outliers: BoolMap) -> _Relief:
        """The relief without some of its points."""
        kept = np.logical_not(outliers)
        plane, _ = np.linalg.qr(self.plane[kept])
        relief = self.relief[kept] - plane @ (plane.T @ self.relief[kept])
        return replace(self, x=self.x[kept], y=self.y[kept], relief=relief, plane=plane)

    def softened(self, width: float) -> _Relief:
        """The same with soft flanks on the known surface, `width` [cells]."""
        from scipy.ndimage import gaussian_filter

        return replace(self, surface=gaussian_filter(self.surface, width * self.per_cell)) if width else self

    def residuals(self, move: Move) -> FloatMap:
        """(k,) relief less the best multiple of the known surface there [m]."""
        known = self._known(move)
        return np.asarray(self.relief - self.gain(move, known) * known, np.float64)

    def gain(self, move: Move, known: FloatMap | None = None) -> float:
        """Factor of the known surface in the relief."""
        known = self._known(move) if known is None else known
        power = float(known @ known)
        return float(known @ self.relief) / power if power > 0.0 else 0.0

    def _known(self, move: Move) -> FloatMap:
        """(k,) known surface at the moved points, less its plane."""
        x, y = _moved(self.x, self.y, move, self.middle)
        i, j = (position / self.pitch * self.per_cell + (self.per_cell - 1) / 2 for position in (x, y))
        from scipy.ndimage import map_coordinates

        known = map_coordinates(self.surface, [i, j], order=1, mode="nearest")
        return np.asarray(known - self.plane @ (self.plane.T @ known), np.float64)

    def registration(self, move: Move) -> Registration:
        """`start` and then the move."""
        x, y = _moved(np.array(self.start.offset_x), np.array(self.start.offset_y), move, self.middle)
        rotation = math.remainder(self.start.rotation + move[2], math.tau)
        return replace(self.start, offset_x=float(x), offset_y=float(y), rotation=rotation)


def _moved(x: FloatMap, y: FloatMap, move: Move, middle: tuple[float, float]) -> tuple[FloatMap, FloatMap]:
    u, v, cos, sin = x - middle[0], y - middle[1], math.cos(move[2]), math.sin(move[2])
    return middle[0] + move[0] + cos * u - sin * v, middle[1] + move[1] + sin * u + cos * v


def _points(map_: HeightMap, size: float) -> tuple[FloatMap, FloatMap, FloatMap]:
    """Centres and means of tiles of about `size` [m], in map coordinates, where at least half a tile was measured."""
    a, b = max(1, round(size / map_.dx)), max(1, round(size / map_.dy))
    m, n = map_.shape[0] // a, map_.shape[1] // b
    tiles = map_.z[: m * a, : n * b].reshape(m, a, n, b)
    count = np.isfinite(tiles).sum(axis=(1, 3))
    mean = np.nansum(tiles, axis=(1, 3)) / np.maximum(count, 1)
    i, j = np.nonzero(2 * count >= a * b)
    x = map_.x0 + (i * a + (a - 1) / 2) * map_.dx
    y = map_.y0 + (j * b + (b - 1) / 2) * map_.dy
    return x.astype(np.float64), y.astype(np.float64), mean[i, j].astype(np.float64)


def _refined(relief: _Relief, first: Move, pitch: float, may_turn: bool) -> Move:
    """The best move near the first one, outliers left out round by round."""
    for _ in range(_ROUNDS):
        move = _least_squares(relief, first, pitch, may_turn)
        residuals = relief.residuals(move)
        noise = _NORMAL * float(np.median(np.abs(residuals)))
        step = relief.gain(move) * float(np.ptp(relief.surface))
        # no smaller limit: flanks have the largest residuals and determine most
        outliers = np.abs(residuals) > max(CLIP * noise, 0.5 * step)
        if not outliers.any() or outliers.mean() > 0.5:
            break
        relief, first = relief.without(outliers), move
    return move


def _least_squares(relief: _Relief, first: Move, pitch: float, may_turn: bool) -> Move:
    scale = max(float(np.sqrt(np.mean(relief.relief**2))), np.finfo(np.float64).tiny)

    def residuals(cells: FloatMap) -> FloatMap:
        return relief.residuals(_move(cells, pitch, relief.radius)) / scale

    start = (first / (pitch, pitch, pitch / relief.radius))[: 3 if may_turn else 2]
    from scipy.optimize import least_squares

    return _move(least_squares(residuals, start, diff_step=[1e-3] * start.size).x, pitch, relief.radius)


def _move(cells: FloatMap, pitch: float, radius: float) -> Move:
    """The move of a shift in cells and, for a fitted rotation, of the rotation as a shift of the rim in cells."""
    return np.array([*cells, 0.0][:3]) * (pitch, pitch, pitch / radius)


def _normal(relief: _Relief, move: Move, pitch: float) -> FloatMap:
    """(3, 3) normal matrix of the residuals by shifts in cells and by the rotation as a shift of the rim in cells."""
    steps = np.diag([0.1 * pitch, 0.1 * pitch, 0.1 * pitch / relief.radius])
    slopes = [(relief.residuals(move + step) - relief.residuals(move - step)) / 0.2 for step in steps]
    jacobian = np.stack(slopes, axis=1)
    return np.asarray(jacobian.T @ jacobian, np.float64)
