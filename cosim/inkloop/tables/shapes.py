"""`[grid]` and `[part]` of the scenario file: where droplets may fall, and the shape that they are to make."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from inkloop.geometry import Cuboid, Cylinder, PipeJunction, Shape, Staircase
from inkloop.units import M_PER_UM

Length = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
Position = Annotated[float, Field(allow_inf_nan=False)]


class Table(BaseModel):
    """A TOML table: unknown keys are errors, values are not converted between types, nothing changes later."""

    # built when a table is first read: the whole scenario holds the others, which need no validator of their own
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, defer_build=True)


class Grid(Table):
    """`[grid]`: the cells."""

    nx: int = Field(ge=1, description="cells along x")
    ny: int = Field(ge=1, description="cells along y")
    pitch_um: Length = Field(default=263.256, description="droplet spacing; 0.6268 x 420 um in Lu et al. 2015, Table I")

    @property
    def pitch(self) -> float:
        """Droplet spacing [m]."""
        return self.pitch_um * M_PER_UM

    @property
    def middle(self) -> tuple[float, float]:
        """Centre of the grid [m]."""
        return (self.nx - 1) / 2 * self.pitch, (self.ny - 1) / 2 * self.pitch


class PartTable(Table):
    """What every shape has: a top, and a centre that defaults to the middle of the grid."""

    height_um: Length = Field(description="height of the flat top over the substrate")
    center_x_um: Position | None = Field(default=None, description="centre along x; default: middle of the grid")
    center_y_um: Position | None = Field(default=None, description="centre along y; default: middle of the grid")

    def _center(self, grid: Grid) -> tuple[float, float]:
        x, y = grid.middle
        return (
            x if self.center_x_um is None else self.center_x_um * M_PER_UM,
            y if self.center_y_um is None else self.center_y_um * M_PER_UM,
        )


class CylinderTable(PartTable):
    """`[part]` with `shape = "cylinder"`."""

    shape: Literal["cylinder"]
    radius_um: Length = Field(description="radius")

    def geometry(self, grid: Grid) -> Shape:
        """The part in space."""
        return Cylinder(*self._center(grid), self.radius_um * M_PER_UM, self.height_um * M_PER_UM)


class CuboidTable(PartTable):
    """`[part]` with `shape = "cuboid"`."""

    shape: Literal["cuboid"]
    size_x_um: Length = Field(description="edge along x")
    size_y_um: Length = Field(description="edge along y")

    def geometry(self, grid: Grid) -> Shape:
        """The part in space."""
        return Cuboid(
            *self._center(grid), self.size_x_um * M_PER_UM, self.size_y_um * M_PER_UM, self.height_um * M_PER_UM
        )


class StaircaseTable(PartTable):
    """`[part]` with `shape = "staircase"`: steps of equal width that rise along x to the full height."""

    shape: Literal["staircase"]
    size_x_um: Length = Field(description="edge along x, all steps together")
    size_y_um: Length = Field(description="edge along y")
    steps: int = Field(ge=1, description="number of steps")

    def geometry(self, grid: Grid) -> Shape:
        """The part in space."""
        edges = self.size_x_um * M_PER_UM, self.size_y_um * M_PER_UM
        return Staircase(*self._center(grid), *edges, self.steps, self.height_um * M_PER_UM)


class PipeJunctionTable(PartTable):
    """`[part]` with `shape = "pipe-junction"`: two elliptic pipes along x and y at half the height."""

    shape: Literal["pipe-junction"]
    outer_across_um: Length = Field(description="outer half-axis in the plane")
    outer_upright_um: Length = Field(description="outer half-axis along z")
    inner_across_um: Length = Field(description="inner half-axis in the plane")
    inner_upright_um: Length = Field(description="inner half-axis along z")

    def geometry(self, grid: Grid) -> Shape:
        """The part in space."""
        return PipeJunction(
            *self._center(grid),
            outer_across=self.outer_across_um * M_PER_UM,
            outer_upright=self.outer_upright_um * M_PER_UM,
            inner_across=self.inner_across_um * M_PER_UM,
            inner_upright=self.inner_upright_um * M_PER_UM,
            height=self.height_um * M_PER_UM,
        )
