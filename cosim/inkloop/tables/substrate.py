"""The surface to print on as a formula: tilt, step, wave and roughness, added up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inkloop.component import FloatMap
from inkloop.geometry import TOLERANCE_M, cell_centers

_ROUGHNESS_STREAM = 1  # added to the seed, so that no component shares the stream


@dataclass(frozen=True)
class Substrate:
    """Slopes along x and y; step height, wave amplitude, wavelength and standard deviation of a cell [m]."""

    tilt_x: float = 0.0
    tilt_y: float = 0.0
    step: float = 0.0
    wave: float = 0.0
    wavelength: float = 5e-3
    roughness: float = 0.0

    def height(self, nx: int, ny: int, pitch: float, seed: int) -> FloatMap:
        """(nx, ny) heights over the lowest cell [m]; roughness is normal, white, and drawn from `seed`."""
        x, y = cell_centers(nx, ny, pitch)
        x, y = x - (nx - 1) / 2 * pitch, y - (ny - 1) / 2 * pitch
        per_length = 2.0 * np.pi / self.wavelength
        surface = self.tilt_x * x + self.tilt_y * y
        surface += np.where(x > TOLERANCE_M, self.step, 0.0)
        surface += self.wave * np.cos(per_length * x) * np.cos(per_length * y)
        surface += self.roughness * np.random.default_rng([seed, _ROUGHNESS_STREAM]).standard_normal((nx, ny))
        return np.asarray(surface - surface.min(), dtype=np.float64)
