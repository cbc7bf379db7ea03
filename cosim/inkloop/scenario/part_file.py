"""The file of a part as a table of a scenario, and the mesh in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import tomlkit
from pydantic import BaseModel, ValidationError
from tomlkit.exceptions import TOMLKitError

from inkloop.errors import ScenarioError
from inkloop.files import regular
from inkloop.geometry.body import Body
from inkloop.geometry.mesh_columns import measured
from inkloop.tables.messages import sentence
from inkloop.tables.part_images import HeightMapTable
from inkloop.tables.part_layers import LayersTable
from inkloop.tables.part_mesh import MeshTable
from inkloop.tables.shapes import Grid, PartError
from inkloop.units import M_PER_UM

MESHES = (".stl", ".obj", ".ply", ".3mf")
LAYERS = ".json"
"""The manifest of a folder of layers."""
FileTable: TypeAlias = MeshTable | LayersTable | HeightMapTable
TABLES: Mapping[str, type[FileTable]] = {
    "mesh": MeshTable,
    "layers": LayersTable,
    "height-map": HeightMapTable,
}
"""Shape -> its table."""
ASSUMED_UNIT = "mm"
"""Unit of meshes in formats that state none, as most programs assume."""
NOWHERE = Grid(nx=1, ny=1, pitch_um=1e12)
"""A cell that holds every part, its centre at (0, 0), where only the box of the part is asked for."""
Valid = TypeVar("Valid", bound=BaseModel)


@dataclass(frozen=True)
class PartFile:
    """A file that holds a part.

    pixel_um, count_scale, channel: of a height map that states no size of its pixels, holds whole numbers, or is one of
    several. rotate_deg: about x, then y, then z; scale: factor; height_um: of the turned part, in place of a scale.
    """

    path: Path
    unit: str | None = None
    pixel_um: float | None = None
    count_scale: float | None = None
    channel: str | None = None
    rotate_deg: list[float] | None = None
    scale: float | None = None
    height_um: float | None = None

    @property
    def shape(self) -> str:
        """`shape` of `[part]`, by the suffix; any file that is neither a mesh nor a manifest is a height map."""
        suffix = self.path.suffix.lower()
        return "mesh" if suffix in MESHES else "layers" if suffix == LAYERS else "height-map"

    @property
    def is_mesh(self) -> bool:
        """Whether it is read as a mesh."""
        return self.shape == "mesh"

    @property
    def assumes_unit(self) -> bool:
        """Whether the unit of its coordinates is assumed."""
        return self.is_mesh and self.unit is None and self.path.suffix.lower() != ".3mf"

    @property
    def mesh_unit(self) -> str | None:
        """Unit of a mesh; None: the file states it."""
        return ASSUMED_UNIT if self.assumes_unit else self.unit

    def table(self) -> FileTable:
        """The table of the part. Raises PartError."""
        keys = {
            "shape": self.shape,
            "file": str(self.path.absolute()),
            "unit": self.mesh_unit,
            "pixel_um": self.pixel_um,
            "count_scale": self.count_scale,
            "channel": self.channel,
            "rotate_deg": self.rotate_deg,
            "scale": self.scale,
        }
        return valid(TABLES[self.shape], {key: value for key, value in keys.items() if value is not None})


def mesh_of_file(file: PartFile) -> tuple[Body, ...] | None:
    """The bodies of a mesh, turned and scaled but not moved; None for any other file. Raises ScenarioError."""
    try:
        table = file.table()
        if not isinstance(table, MeshTable):
            return None
        bodies = table.read(Path())
        return scaled(table, bodies, file.height_um).model_copy(update={"place": "as-is"}).placed(bodies, NOWHERE)
    except PartError as error:
        raise ScenarioError(str(file.path), error.errors) from error


def mesh_of_scenario(path: Path) -> tuple[Body, ...] | None:
    """The bodies of a scenario whose part is a mesh, as it places them; None for any other, and for one with errors."""
    try:
        raw = tomlkit.parse(regular(path).read_text(encoding="utf-8")).unwrap()
        table, grid = MeshTable.model_validate(raw["part"]), Grid.model_validate(raw["grid"])
        return table.placed(table.read(path.parent), grid)
    except (OSError, UnicodeDecodeError, TOMLKitError, KeyError, ValidationError, PartError):
        return None  # reported, where it is an error, with all others of the scenario


def valid(table: type[Valid], keys: Mapping[str, Any]) -> Valid:
    """A table of these keys. Raises PartError."""
    try:
        return table.model_validate(keys)
    except ValidationError as error:
        raise PartError([sentence(detail, table) for detail in error.errors()]) from error


def scaled(table: MeshTable, bodies: Sequence[Body], height_um: float | None) -> MeshTable:
    """The table with the scale that gives the turned bodies a height, if one is asked for. Raises PartError."""
    if height_um is None:
        return table
    low, high, *_ = measured(table.placed(bodies, NOWHERE))
    if not high[2] > low[2]:
        raise PartError(["file: is flat, and no scale gives it a height; turn it (--rotate)"])
    return table.model_copy(update={"scale": float(f"{height_um * M_PER_UM / (high[2] - low[2]):.9g}")})
