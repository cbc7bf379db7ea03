"""A measured height map: fine pixels, each with a height or none."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from inkloop.component import BoolMap, FloatMap
from inkloop.errors import HeightMapError
from inkloop.units import UM_PER_M

__all__ = ["HeightMap", "Mirror"]

Mirror: TypeAlias = Literal["none", "x", "y"]


@dataclass(frozen=True, eq=False)
class HeightMap:
    """Heights of a regular grid of pixels in the coordinates of the profiler.

    z: (m, n) [m], i along x, j along y, NaN where nothing was measured (infinities become NaN); dx, dy: size of a pixel
    [m]; x0, y0: centre of pixel (0, 0) [m]; source: its name in messages; remark: what its file states. Raises
    HeightMapError.
    """

    z: FloatMap
    dx: float
    dy: float
    x0: float = 0.0
    y0: float = 0.0
    source: str = "height map"
    remark: str = ""

    def __post_init__(self) -> None:
        z = np.array(self.z, dtype=np.float64)
        if z.ndim != 2 or z.size == 0:
            raise HeightMapError(f"{self.source}: holds an array of shape {z.shape}; a map needs rows and columns")
        for name in ("dx", "dy"):
            size = getattr(self, name)
            if not (np.isfinite(size) and size > 0):
                raise HeightMapError(f"{self.source}: the pixel size {name} is {size} m; needs a length above 0")
        z[~np.isfinite(z)] = np.nan
        z.flags.writeable = False
        object.__setattr__(self, "z", z)

    @property
    def shape(self) -> tuple[int, int]:
        """Pixels along x and along y."""
        return self.z.shape[0], self.z.shape[1]

    @property
    def valid(self) -> BoolMap:
        """(m, n), true where a height was measured."""
        return np.isfinite(self.z)

    @property
    def field(self) -> tuple[float, float]:
        """Width and depth of all pixels [m]."""
        return self.shape[0] * self.dx, self.shape[1] * self.dy

    def __str__(self) -> str:
        """Size, range of heights and remark, for a person."""
        dx, dy, width, depth = (f"{size * UM_PER_M:.6g}" for size in (self.dx, self.dy, *self.field))
        pixels = f"{self.shape[0]} x {self.shape[1]} pixels of {dx} x {dy} µm, a field of {width} x {depth} µm"
        if self.shape[1] == 1:
            pixels = f"a profile of {self.shape[0]} points, {dx} µm apart, {width} µm long"
        heights = self.z[self.valid] * UM_PER_M
        between = f"heights from {heights.min():.6g} to {heights.max():.6g} µm" if heights.size else "no heights"
        return ", ".join(filter(None, (pixels, between, self.remark)))
