"""Parts as analytic shapes: their intervals of height over each point of the substrate.

Coordinates are metres with the origin at the centre of cell (0, 0); x runs along the first index of a height map. A
point on the surface belongs to the part: cells are often cut exactly there (a radius of 15 cells), so distances are
compared with a tolerance far below any droplet. `contains` tests one height against `intervals`, so that both agree to
the last bit. Walls and ends are closed here; those of `Columns`, of a mesh for example, are half open.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from inkloop.component import BoolMap, FloatMap, Geometry, HeightIntervals

TOLERANCE_M = 1e-12


class Shape(Geometry, Protocol):
    """A geometry that rests on the substrate."""

    @property
    def height(self) -> float:
        """Height of its highest point over the substrate [m]."""

    def top(self, x: FloatMap, y: FloatMap) -> FloatMap:
        """Height of the top over the substrate at (x, y), within the footprint [m]."""


def contained(intervals: HeightIntervals, z: FloatMap) -> BoolMap:
    """True where the height z [m] lies in one of the intervals."""
    inside: BoolMap = np.any([(bottom <= z) & (z <= top) for bottom, top in intervals], axis=0)
    return inside


def _contains(shape: Geometry, x: FloatMap, y: FloatMap, z: FloatMap) -> BoolMap:
    """True where (x, y, z) [m] lies in the shape."""
    return contained(shape.intervals(x, y), z)


def _flat(shape: Shape, x: FloatMap, y: FloatMap) -> FloatMap:
    """The same height everywhere [m]."""
    return np.full_like(x, shape.height)


def _up_to_top(shape: Shape, x: FloatMap, y: FloatMap, inside: BoolMap) -> HeightIntervals:
    """From the substrate to the top where `inside` [m], nothing elsewhere."""
    return ((np.where(inside, -TOLERANCE_M, np.inf), shape.top(x, y) + TOLERANCE_M),)


def _on_rectangle(shape: Cuboid | Staircase, x: FloatMap, y: FloatMap) -> HeightIntervals:
    """From the substrate to the top over the base [m]."""
    inside_x = np.abs(x - shape.center_x) <= shape.size_x / 2 + TOLERANCE_M
    inside_y = np.abs(y - shape.center_y) <= shape.size_y / 2 + TOLERANCE_M
    return _up_to_top(shape, x, y, inside_x & inside_y)


@dataclass(frozen=True)
class Cylinder:
    """Upright cylinder: centre of the axis, radius and height [m]."""

    center_x: float
    center_y: float
    radius: float
    height: float

    contains = _contains
    top = _flat

    def intervals(self, x: FloatMap, y: FloatMap) -> HeightIntervals:
        """From the substrate to the top [m]."""
        distance = np.hypot(x - self.center_x, y - self.center_y)
        return _up_to_top(self, x, y, distance <= self.radius + TOLERANCE_M)


@dataclass(frozen=True)
class Cuboid:
    """Upright cuboid: centre of the base, edge lengths and height [m]."""

    center_x: float
    center_y: float
    size_x: float
    size_y: float
    height: float

    contains = _contains
    intervals = _on_rectangle
    top = _flat


@dataclass(frozen=True)
class Staircase:
    """Steps of equal height and width that rise along x: centre of the base, edges of the base, height [m]."""

    center_x: float
    center_y: float
    size_x: float
    size_y: float
    steps: int
    height: float

    contains = _contains
    intervals = _on_rectangle

    def top(self, x: FloatMap, y: FloatMap) -> FloatMap:
        """The step at x [m]; a point on an edge belongs to the lower step."""
        along = (x - self.center_x + self.size_x / 2 - TOLERANCE_M) / self.size_x
        step = np.clip(np.ceil(along * self.steps), 1, self.steps)
        return np.asarray(step * self.height / self.steps)


@dataclass(frozen=True)
class PipeJunction:
    """Two elliptic pipes, one along x and one along y, that meet at half the height (Lu et al. 2015, Fig. 14).

    Half-axes of the outer and inner wall, across the pipe and upright [m]; the bores are open into each other.
    """

    center_x: float
    center_y: float
    outer_across: float
    outer_upright: float
    inner_across: float
    inner_upright: float
    height: float

    contains = _contains
    top = _flat

    def intervals(self, x: FloatMap, y: FloatMap) -> HeightIntervals:
        """The wall below the bores and the wall above them [m]; where there is no bore, both walls in one."""
        outer = self._half_height(x, y, self.outer_across, self.outer_upright)
        inner = self._half_height(x, y, self.inner_across, self.inner_upright)
        middle, is_bored = self.height / 2, inner >= 0.0
        below = np.where(is_bored, np.nextafter(middle - inner, -np.inf), middle + outer)
        above = np.where(is_bored, np.nextafter(middle + inner, np.inf), np.inf)
        return (middle - outer, below), (above, middle + outer)

    def _half_height(self, x: FloatMap, y: FloatMap, half_across: float, half_upright: float) -> FloatMap:
        """Half height of two elliptic cylinders, above and below the middle [m], -inf beside both."""
        across = np.minimum(np.abs(x - self.center_x), np.abs(y - self.center_y))
        left = 1.0 + 1e-9 - (across / half_across) ** 2
        return np.where(left >= 0.0, half_upright * np.sqrt(np.maximum(left, 0.0)), -np.inf)
