"""`[substrate]`: the surface to print on as a formula: tilt, step, wave and roughness, added up."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from inkloop.component import FloatMap
from inkloop.geometry import TOLERANCE_M, cell_centers
from inkloop.tables.shapes import Length, Position, Table
from inkloop.units import M_PER_UM

_ROUGHNESS_STREAM = 1  # added to the seed, so that no component shares the stream


class SubstrateTable(Table):
    """`[substrate]`: the surface to print on, over its lowest cell; only the printer knows it."""

    tilt_x: Position = Field(default=0.0, description="slope along x")
    tilt_y: Position = Field(default=0.0, description="slope along y")
    step_um: Position = Field(default=0.0, description="height of a step up, along the middle of the grid in x")
    wave_um: float = Field(default=0.0, ge=0.0, allow_inf_nan=False, description="amplitude of an egg-box wave")
    wavelength_um: Length = Field(default=5000.0, description="wavelength of the wave along x and along y")
    roughness_um: float = Field(
        default=0.0, ge=0.0, allow_inf_nan=False, description="standard deviation of a cell, drawn from the seed"
    )

    def height(self, nx: int, ny: int, pitch: float, seed: int) -> FloatMap:
        """(nx, ny) heights over the lowest cell [m]; roughness is normal, white, and drawn from `seed`."""
        x, y = cell_centers(nx, ny, pitch)
        x, y = x - (nx - 1) / 2 * pitch, y - (ny - 1) / 2 * pitch
        per_length = 2.0 * np.pi / (self.wavelength_um * M_PER_UM)
        surface = self.tilt_x * x + self.tilt_y * y
        surface += np.where(x > TOLERANCE_M, self.step_um * M_PER_UM, 0.0)
        surface += self.wave_um * M_PER_UM * np.cos(per_length * x) * np.cos(per_length * y)
        roughness = self.roughness_um * M_PER_UM
        surface += roughness * np.random.default_rng([seed, _ROUGHNESS_STREAM]).standard_normal((nx, ny))
        return np.asarray(surface - surface.min(), dtype=np.float64)
