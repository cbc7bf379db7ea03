"""`[grid]`, the formulas of `[part]`, and `[substrate]`: the cells, what a part comes to on them, what it stands on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from inkloop.component import FloatMap
from inkloop.geometry import TOLERANCE_M, Columns, Cuboid, Cylinder, PipeJunction, Shape, Staircase, cell_centers
from inkloop.units import M_PER_UM

__all__ = ["Length", "Position", "Table"]

Length = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
PITCH_MIN_UM = 1.0  # no head is that fine (assumed); a smaller number was meant in other units
_ROUGHNESS_STREAM = 1  # added to the seed, so that no component shares the stream
Position = Annotated[float, Field(allow_inf_nan=False)]


class Bounds(NamedTuple):
    """The box around a part in the plane [m], in coordinates of the grid."""

    x_min: float
    x_max: float
    y_min: float
    y_max: float


@dataclass(frozen=True, eq=False)
class Solid:
    """A part on the grid of a scenario.

    region: region of ink A, None: everywhere; remarks: notes for the user, one sentence each; volume: of the part in
    its file, not of its cells [m3], None: unknown; volume_is_sampled: whether only SAMPLED_DIGITS of it are known.
    """

    shape: Shape
    bounds: Bounds
    region: Columns | None = None
    remarks: tuple[str, ...] = ()
    volume: float | None = None
    volume_is_sampled: bool = False

    def columns(self, nx: int, ny: int, pitch: float) -> Columns:
        """The shape over the cells of the grid; columns are taken as they are."""
        return self.shape if isinstance(self.shape, Columns) else Columns.of_shape(self.shape, nx, ny, pitch)


class PartError(Exception):
    """A part that cannot be made; `errors` holds one sentence each, with the key of `[part]` in front."""

    def __init__(self, errors: Sequence[str]) -> None:
        self.errors = tuple(errors)
        super().__init__("; ".join(self.errors))


def nothing(nx: int, ny: int, pitch: float) -> Columns:
    """No material on any cell."""
    return Columns(nx, ny, pitch, np.zeros(nx * ny + 1, np.int64), np.zeros(0), np.zeros(0))


class Table(BaseModel):
    """A TOML table: unknown keys are errors, values are not converted between types, nothing changes later."""

    # built when a table is first read: a table within the scenario needs no validator of its own
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, defer_build=True)


class Grid(Table):
    """`[grid]`: the cells."""

    nx: int = Field(ge=1, description="cells along x")
    ny: int = Field(ge=1, description="cells along y")
    pitch_um: Length = Field(
        default=263.256, ge=PITCH_MIN_UM, description="droplet spacing; 0.6268 x 420 µm in Lu et al. 2015, Table I"
    )

    @property
    def pitch(self) -> float:
        """Droplet spacing [m]."""
        return self.pitch_um * M_PER_UM

    @property
    def middle(self) -> tuple[float, float]:
        """Centre of the grid [m]."""
        return (self.nx - 1) / 2 * self.pitch, (self.ny - 1) / 2 * self.pitch


class PlacedTable(Table):
    """Common keys of all parts: a centre that defaults to the middle of the grid, and an ink."""

    center_x_um: Position | None = Field(default=None, description="centre along x; default: middle of the grid")
    center_y_um: Position | None = Field(default=None, description="centre along y; default: middle of the grid")

    def _center(self, grid: Grid) -> tuple[float, float]:
        x, y = grid.middle
        return (
            x if self.center_x_um is None else self.center_x_um * M_PER_UM,
            y if self.center_y_um is None else self.center_y_um * M_PER_UM,
        )


class PartTable(PlacedTable):
    """Common properties of analytic shapes: a flat top, and a box around it."""

    height_um: Length = Field(description="height of the flat top over the substrate")

    def _solid(self, shape: Shape, grid: Grid, half_x: float, half_y: float) -> Solid:
        x, y = self._center(grid)
        return Solid(shape, Bounds(x - half_x, x + half_x, y - half_y, y + half_y))


class CylinderTable(PartTable):
    """`[part]` with `shape = "cylinder"`."""

    shape: Literal["cylinder"]
    radius_um: Length = Field(description="radius")

    def solid(self, grid: Grid, folder: Path) -> Solid:
        """The part in space."""
        radius = self.radius_um * M_PER_UM
        return self._solid(Cylinder(*self._center(grid), radius, self.height_um * M_PER_UM), grid, radius, radius)


class CuboidTable(PartTable):
    """`[part]` with `shape = "cuboid"`."""

    shape: Literal["cuboid"]
    size_x_um: Length = Field(description="edge along x")
    size_y_um: Length = Field(description="edge along y")

    def solid(self, grid: Grid, folder: Path) -> Solid:
        """The part in space."""
        edges = self.size_x_um * M_PER_UM, self.size_y_um * M_PER_UM
        shape = Cuboid(*self._center(grid), *edges, self.height_um * M_PER_UM)
        return self._solid(shape, grid, edges[0] / 2, edges[1] / 2)


class StaircaseTable(PartTable):
    """`[part]` with `shape = "staircase"`: steps of equal width that rise along x to the full height."""

    shape: Literal["staircase"]
    size_x_um: Length = Field(description="edge along x, all steps together")
    size_y_um: Length = Field(description="edge along y")
    steps: int = Field(ge=1, description="number of steps")

    def solid(self, grid: Grid, folder: Path) -> Solid:
        """The part in space."""
        edges = self.size_x_um * M_PER_UM, self.size_y_um * M_PER_UM
        shape = Staircase(*self._center(grid), *edges, self.steps, self.height_um * M_PER_UM)
        return self._solid(shape, grid, edges[0] / 2, edges[1] / 2)


class PipeJunctionTable(PartTable):
    """`[part]` with `shape = "pipe-junction"`: two elliptic pipes along x and y at half the height."""

    shape: Literal["pipe-junction"]
    outer_across_um: Length = Field(description="outer half-axis in the plane")
    outer_upright_um: Length = Field(description="outer half-axis along z")
    inner_across_um: Length = Field(description="inner half-axis in the plane")
    inner_upright_um: Length = Field(description="inner half-axis along z")

    def solid(self, grid: Grid, folder: Path) -> Solid:
        """The part in space."""
        shape = PipeJunction(
            *self._center(grid),
            outer_across=self.outer_across_um * M_PER_UM,
            outer_upright=self.outer_upright_um * M_PER_UM,
            inner_across=self.inner_across_um * M_PER_UM,
            inner_upright=self.inner_upright_um * M_PER_UM,
            height=self.height_um * M_PER_UM,
        )
        return self._solid(shape, grid, math.inf, math.inf)


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
