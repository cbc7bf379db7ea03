"""`[part]`: its shapes, and combinations of several."""

from __future__ import annotations

from functools import reduce
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from inkloop.geometry import Columns
from inkloop.tables.part_images import HeightMapTable, StackTable
from inkloop.tables.part_layers import LayersTable
from inkloop.tables.part_mesh import MeshTable
from inkloop.tables.shapes import (
    Bounds,
    CuboidTable,
    CylinderTable,
    Grid,
    PartError,
    PipeJunctionTable,
    Solid,
    StaircaseTable,
    Table,
    nothing,
)


class CombineTable(Table):
    """`[part]` with `shape = "combine"`: several parts on one plate, or one with another cut out of it."""

    shape: Literal["combine"]
    op: Literal["union", "difference", "intersection"] = Field(
        description='"union": all parts, "difference": the first without the others, "intersection": what all share'
    )
    parts: list[Part] = Field(min_length=2, description="tables like `[part]`, each with its own position")
    inks: list[Literal["A", "B"]] | None = Field(
        default=None, description="ink of each part; none: as the parts have it; where parts overlap, the first counts"
    )

    def solid(self, grid: Grid, folder: Path) -> Solid:
        """The parts on the grid, combined. Raises PartError with the errors of all of them."""
        solids, errors = [], []
        if self.inks is not None and len(self.inks) != len(self.parts):
            errors.append(f"inks has {len(self.inks)} entries for {len(self.parts)} parts; give one for each")
        for number, table in enumerate(self.parts):
            try:
                solids.append(table.solid(grid, folder))
            except PartError as error:
                errors += [f"parts.[{number}].{wrong}" for wrong in error.errors]
        if errors:
            raise PartError(errors)
        bodies = [solid.columns(*_grid(grid)) for solid in solids]
        in_a = [solid.region or body for solid, body in zip(solids, bodies, strict=True)]
        has_two = any(solid.region is not None for solid in solids)
        if self.inks is not None:
            has_two = "B" in self.inks
            in_a = [body if ink == "A" else nothing(*_grid(grid)) for ink, body in zip(self.inks, bodies, strict=True)]
        body, of_a = _OPERATIONS[self.op](bodies, in_a)
        remarks = tuple(
            f"parts.[{number}]: {remark}" for number, solid in enumerate(solids) for remark in solid.remarks
        )
        return Solid(body, _bounds(self.op, [solid.bounds for solid in solids]), of_a if has_two else None, remarks)


Part: TypeAlias = Annotated[
    CylinderTable
    | CuboidTable
    | StaircaseTable
    | PipeJunctionTable
    | MeshTable
    | StackTable
    | LayersTable
    | HeightMapTable
    | CombineTable,
    Field(discriminator="shape"),
]
CombineTable.model_rebuild()  # now that the types of its parts are known


def _grid(grid: Grid) -> tuple[int, int, float]:
    return grid.nx, grid.ny, grid.pitch


def _union(bodies: list[Columns], in_a: list[Columns]) -> tuple[Columns, Columns]:
    """All parts, and their ink A; where parts overlap, the first one counts."""
    whole, of_a = bodies[0], in_a[0]
    for body, more in zip(bodies[1:], in_a[1:], strict=True):
        of_a |= more - whole
        whole |= body
    return whole, of_a


def _difference(bodies: list[Columns], in_a: list[Columns]) -> tuple[Columns, Columns]:
    return reduce(Columns.__sub__, bodies), reduce(Columns.__sub__, bodies[1:], in_a[0])


def _intersection(bodies: list[Columns], in_a: list[Columns]) -> tuple[Columns, Columns]:
    return reduce(Columns.__and__, bodies), reduce(Columns.__and__, bodies[1:], in_a[0])


_OPERATIONS = {"union": _union, "difference": _difference, "intersection": _intersection}


def _bounds(op: str, bounds: list[Bounds]) -> Bounds:
    """The box around a combination."""
    if op == "difference":
        return bounds[0]
    low, high = (min, max) if op == "union" else (max, min)
    x_min, x_max, y_min, y_max = zip(*bounds, strict=True)
    return Bounds(low(x_min), high(x_max), low(y_min), high(y_max))
