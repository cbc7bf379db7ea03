"""Parts as analytic shapes: which points belong to them, which cells they stand on.

Coordinates are metres with the origin at the centre of cell (0, 0); x runs along the first index of a height map.
A point on the surface belongs to the part: cells are often cut exactly there (a radius of 15 cells), so
distances are compared with a tolerance far below any droplet.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from inkloop.component import BoolMap, FloatMap, Geometry

TOLERANCE_M = 1e-12


class Shape(Geometry, Protocol):
    """A geometry that rests on the substrate."""

    @property
    def height(self) -> float:
        """Height of its highest point over the substrate [m]."""

    def top(self, x: FloatMap, y: FloatMap) -> FloatMap:
        """Height of the top over the substrate at (x, y), within the footprint [m]."""


@dataclass(frozen=True)
class Cylinder:
    """Upright cylinder: centre of the axis, radius and height [m]."""

    center_x: float
    center_y: float
    radius: float
    height: float

    def contains(self, x: FloatMap, y: FloatMap, z: FloatMap) -> BoolMap:
        """True where (x, y, z) [m] lies in the cylinder."""
        distance = np.hypot(x - self.center_x, y - self.center_y)
        return (distance <= self.radius + TOLERANCE_M) & _between(z, 0.0, self.height)

    def top(self, x: FloatMap, y: FloatMap) -> FloatMap:
        """Flat [m]."""
        return np.full_like(x, self.height)


@dataclass(frozen=True)
class Cuboid:
    """Upright cuboid: centre of the base, edge lengths and height [m]."""

    center_x: float
    center_y: float
    size_x: float
    size_y: float
    height: float

    def contains(self, x: FloatMap, y: FloatMap, z: FloatMap) -> BoolMap:
        """True where (x, y, z) [m] lies in the cuboid."""
        inside_x = np.abs(x - self.center_x) <= self.size_x / 2 + TOLERANCE_M
        inside_y = np.abs(y - self.center_y) <= self.size_y / 2 + TOLERANCE_M
        return inside_x & inside_y & _between(z, 0.0, self.height)

    def top(self, x: FloatMap, y: FloatMap) -> FloatMap:
        """Flat [m]."""
        return np.full_like(x, self.height)


@dataclass(frozen=True)
class Staircase:
    """Steps of equal height and width that rise along x: centre of the base, edges of the base, height [m]."""

    center_x: float
    center_y: float
    size_x: float
    size_y: float
    steps: int
    height: float

    def contains(self, x: FloatMap, y: FloatMap, z: FloatMap) -> BoolMap:
        """True where (x, y, z) [m] lies in the staircase."""
        inside_x = np.abs(x - self.center_x) <= self.size_x / 2 + TOLERANCE_M
        inside_y = np.abs(y - self.center_y) <= self.size_y / 2 + TOLERANCE_M
        return inside_x & inside_y & _between(z, 0.0, self.top(x, y))

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

    def contains(self, x: FloatMap, y: FloatMap, z: FloatMap) -> BoolMap:
        """True where (x, y, z) [m] lies in the wall of a pipe."""
        along_x, along_y = y - self.center_y, x - self.center_x
        outer = self._in_pipe(along_x, z, self.outer_across, self.outer_upright)
        outer |= self._in_pipe(along_y, z, self.outer_across, self.outer_upright)
        inner = self._in_pipe(along_x, z, self.inner_across, self.inner_upright)
        inner |= self._in_pipe(along_y, z, self.inner_across, self.inner_upright)
        return outer & ~inner

    def top(self, x: FloatMap, y: FloatMap) -> FloatMap:
        """Flat [m]."""
        return np.full_like(x, self.height)

    def _in_pipe(self, across: FloatMap, z: FloatMap, half_across: float, half_upright: float) -> BoolMap:
        upright = z - self.height / 2
        inside: BoolMap = (across / half_across) ** 2 + (upright / half_upright) ** 2 <= 1.0 + 1e-9
        return inside


def cell_centers(nx: int, ny: int, pitch: float) -> tuple[FloatMap, FloatMap]:
    """x and y of every cell, each (nx, ny) [m]."""
    x, y = np.meshgrid(np.arange(nx) * pitch, np.arange(ny) * pitch, indexing="ij")
    return x, y


def _between(z: FloatMap, low: float, high: float | FloatMap) -> BoolMap:
    return (z >= low - TOLERANCE_M) & (z <= high + TOLERANCE_M)
