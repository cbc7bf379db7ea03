"""Height maps of a profiler from a surface of cells: fine pixels, turned and shifted, as stated in the file."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.metrology.height_map import HeightMap
from inkloop.metrology.registration import Registration


def fine_map(
    surface: NDArray[Any], pitch: float, registration: Registration, shape: tuple[int, int], pixel: float, **fields: Any
) -> HeightMap:
    """The cells of `surface` (nx, ny) [m] seen at the pixels of a map that lies there; 0 outside the grid."""
    x, y = (np.arange(cells, dtype=np.float64) * pixel for cells in shape)
    on_grid = registration.to_grid(x[:, None], y)
    i, j = (np.floor(position / pitch + 0.5).astype(int) for position in on_grid)
    inside = (i >= 0) & (i < surface.shape[0]) & (j >= 0) & (j < surface.shape[1])
    heights = surface[i.clip(0, surface.shape[0] - 1), j.clip(0, surface.shape[1] - 1)]
    return HeightMap(np.where(inside, heights, 0.0), pixel, pixel, **fields)


def covering(
    nx: int, ny: int, pitch: float, pixel: float, rotation: float, margin: float
) -> tuple[Registration, tuple[int, int]]:
    """A registration with which a map of the returned shape covers a grid and `margin` [m] around it."""
    width, depth = nx * pitch + 2 * margin, ny * pitch + 2 * margin
    cos, sin = np.cos(rotation), np.sin(rotation)
    field = abs(cos) * width + abs(sin) * depth, abs(sin) * width + abs(cos) * depth
    middle = (nx - 1) / 2 * pitch, (ny - 1) / 2 * pitch
    shape = int(np.ceil(field[0] / pixel)), int(np.ceil(field[1] / pixel))
    u, v = (shape[0] - 1) / 2 * pixel, (shape[1] - 1) / 2 * pixel
    offset = middle[0] - (cos * u - sin * v), middle[1] - (sin * u + cos * v)
    return Registration(float(offset[0]), float(offset[1]), rotation), shape
