"""`[part]` of a mesh: STL, OBJ, PLY, and 3MF with its objects in two inks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from inkloop.errors import GeometryError
from inkloop.geometry import Columns
from inkloop.geometry.body import Body, Placement, walls_on_centers
from inkloop.geometry.mending import is_closed
from inkloop.geometry.mesh import OpenColumns, bodies_by_ink, closed_columns, painted
from inkloop.geometry.mesh_columns import MeshColumns, measured
from inkloop.geometry.mesh_file import read_bodies
from inkloop.tables.shapes import Bounds, Grid, Length, PartError, PlacedTable, Position, Solid
from inkloop.units import UM_PER_M

COARSE = 0.01
"""Share of the pitch beyond which rounded coordinates show in the part (assumed)."""
ROUNDED = 1e-9
"""Share of the volume that rounding lets bodies share."""
_LISTED = 3
_OPEN = (
    "the surface is not closed, so that its inside is a guess where a column meets a hole; `inkloop geometry` lists "
    "the holes"
)


class MeshTable(PlacedTable):
    """`[part]` with `shape = "mesh"`: closed surfaces of triangles."""

    shape: Literal["mesh"]
    file: str = Field(description="the mesh, relative to the scenario: STL, OBJ, PLY or 3MF")
    unit: Literal["um", "mm", "cm", "m", "in", "ft"] | None = Field(
        default=None, description="of the coordinates; required unless the file states it, as 3MF does"
    )
    place: Literal["on-substrate", "as-is"] = Field(
        default="on-substrate",
        description='"on-substrate": the middle of its box at the centre, its lowest point at z = 0; "as-is": as the '
        "file has it, with the origin at the centre of cell (0, 0)",
    )
    rotate_deg: Annotated[list[Position], Field(min_length=3, max_length=3)] = Field(
        default=[0.0, 0.0, 0.0], description="about x, then y, then z, counterclockwise seen against the axis"
    )
    scale: Length = Field(default=1.0, description="factor on all coordinates")
    mirror: Literal["none", "x", "y", "z"] = Field(default="none", description="coordinate whose sign changes")
    inks: dict[str, Literal["A", "B"]] | None = Field(
        default=None, description="ink of each object or material, by its name in the 3MF; none: one ink"
    )
    open_columns: OpenColumns = Field(
        default="refuse",
        description='columns of cells that holes leave open: "refuse", or "neighbours" fills up to 0.1 % of them',
    )

    def read(self, folder: Path) -> tuple[Body, ...]:
        """The bodies of the file. Raises PartError."""
        try:
            return read_bodies(folder / self.file, self.unit)
        except GeometryError as error:
            raise PartError([f"file: {error}"]) from error

    def solid(self, grid: Grid, folder: Path, read: Sequence[Body] = ()) -> Solid:
        """The part on the grid; read: the bodies of the file, where they are at hand. Raises PartError."""
        source, bodies = str(folder / self.file), self.placed(read or self.read(folder), grid)
        try:
            by_ink = {"A": bodies} if self.inks is None else bodies_by_ink(source, bodies, self.inks)
            found = {ink: self._columns(source, of_ink, grid) for ink, of_ink in by_ink.items()}
        except GeometryError as error:
            raise PartError([f"file: {error}"]) from error
        whole, region = _joined({ink: each.columns for ink, each in found.items()})
        shared = sum(each.overlap + each.columns.volume for each in found.values()) - whole.volume
        own = measured(bodies, abs(shared) > ROUNDED * whole.volume)
        box = Bounds(*(float(end[axis]) for axis in (0, 1) for end in (own.low, own.high)))
        is_whole = is_closed(np.concatenate([body.triangles for body in bodies]))
        has_volume = is_whole and not any(each.open_cells.size for each in found.values())
        remarks = list(dict.fromkeys(remark for body in bodies for remark in body.remarks))
        remarks += [] if self.inks else [f"{painted(body)}: all of it is ink A" for body in bodies if body.paint]
        remarks += [] if is_whole else [_OPEN]
        volume = own.volume if has_volume else None
        return Solid(whole, box, region, (*remarks, *_remarks(bodies, grid)), volume, own.volume_is_sampled)

    def placed(self, bodies: Sequence[Body], grid: Grid) -> tuple[Body, ...]:
        """Bodies of the file where the table puts them. Raises PartError."""
        is_moved = self.center_x_um is not None or self.center_y_um is not None
        if is_moved and self.place == "as-is":
            raise PartError(['center_x_um, center_y_um: place is "as-is", which moves nothing; leave one of them out'])
        try:
            placement = Placement(
                self.place,
                (self.rotate_deg[0], self.rotate_deg[1], self.rotate_deg[2]),
                self.scale,
                "" if self.mirror == "none" else self.mirror,
                self._center(grid) if is_moved else None,
            )
        except ValueError as error:
            raise PartError([str(error)]) from error
        return placement.placed(bodies, grid.nx, grid.ny, grid.pitch)

    def _columns(self, source: str, bodies: Sequence[Body], grid: Grid) -> MeshColumns:
        return closed_columns(source, bodies, grid.nx, grid.ny, grid.pitch, self.open_columns)


def _joined(by_ink: dict[str, Columns]) -> tuple[Columns, Columns | None]:
    """The whole, and ink A of it where there are two inks."""
    of_a, of_b = by_ink.get("A"), by_ink.get("B")
    if of_b is None:
        assert of_a is not None
        return of_a, None
    return (of_b, of_b - of_b) if of_a is None else (of_a | of_b, of_a)


def _remarks(bodies: Sequence[Body], grid: Grid) -> Iterator[str]:
    resolution = max(body.resolution for body in bodies)
    if resolution > COARSE * grid.pitch:
        yield (
            f"so far from the origin the coordinates of the file resolve {resolution * UM_PER_M:.3g} µm, which moves "
            "walls by parts of a cell; move the part to the origin and save it again"
        )
        return
    walls = walls_on_centers(bodies, grid.pitch)
    if walls:
        shown = ", ".join(f"{wall * UM_PER_M:.6g}" for wall in walls[:_LISTED]) + (
            ", ..." if len(walls) > _LISTED else ""
        )
        yield (
            f"{len(walls)} upright walls stand on rows of cell centres, where rounding decides on which side a cell is "
            f"(at {shown} µm); shift the part by half a pitch: center_x_um, center_y_um, or grid.nx, grid.ny by 1"
        )
