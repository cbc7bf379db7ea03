"""From the file of a part to a scenario that prints it: its table, a grid around it, and further keys."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomlkit
from pydantic import ValidationError
from tomlkit.exceptions import TOMLKitError

from inkloop.component import Ink
from inkloop.errors import GeometryError, ScenarioError
from inkloop.geometry import overhangs
from inkloop.geometry.body import Body, bounds
from inkloop.geometry.mesh_file import read_bodies
from inkloop.limits import memory_error
from inkloop.scenario.footprint import BYTES_OF_A_CELL, ROUNDING
from inkloop.scenario.validation import EMPTY_CELLS
from inkloop.tables.messages import sentence
from inkloop.tables.part_images import HeightMapTable
from inkloop.tables.part_layers import LayersTable
from inkloop.tables.part_mesh import MeshTable
from inkloop.tables.schema import ScenarioFile
from inkloop.tables.shapes import Grid, PartError, Solid
from inkloop.units import M_PER_UM, MM_PER_M, UM_PER_M

MESHES = (".stl", ".obj", ".ply", ".3mf")
LAYERS = ".json"
"""The manifest of a folder of layers."""
TABLES: Mapping[str, type[MeshTable | LayersTable | HeightMapTable]] = {
    "mesh": MeshTable,
    "layers": LayersTable,
    "height-map": HeightMapTable,
}
"""Shape -> its table."""
ASSUMED_UNIT = "mm"
"""Unit of meshes in formats that state none, as most programs assume."""
PITCHES_UM = (Grid.model_fields["pitch_um"].default, 127.0, 84.667, 42.333, 21.167)
"""Pitches: that of Lu et al. 2015, then 200, 300, 600 and 1200 dots per inch."""
CELLS_MIN = 40
"""Cells along the longer side of a part that show its shape (assumed)."""


@dataclass(frozen=True)
class PartFile:
    """A file that holds a part.

    pixel_um, count_scale: of a height map that states no size of its pixels, or holds whole numbers.
    """

    path: Path
    unit: str | None = None
    pixel_um: float | None = None
    count_scale: float | None = None

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

    def keys(self, file: str) -> dict[str, Any]:
        """The keys of `[part]`; file: its path as the scenario names it."""
        keys = {
            "shape": self.shape,
            "file": file,
            "unit": self.mesh_unit,
            "pixel_um": self.pixel_um,
            "count_scale": self.count_scale,
        }
        return {key: value for key, value in keys.items() if value is not None}

    def table(self) -> MeshTable | LayersTable | HeightMapTable:
        """The table of the part. Raises ScenarioError."""
        table = TABLES[self.shape]
        try:
            return table.model_validate(self.keys(str(self.path.absolute())))
        except ValidationError as error:
            raise ScenarioError(str(self.path), [sentence(detail, table) for detail in error.errors()]) from error


@dataclass(frozen=True)
class FittedPart:
    """A part on a grid that was made for it. names: of objects and materials; hangs: whether it has overhangs."""

    grid: Grid
    solid: Solid
    size_um: tuple[float, float, float]
    names: tuple[str, ...]
    hangs: bool


def fit(file: PartFile, pitch_um: float | None) -> FittedPart:
    """Lay a grid around a part, with empty cells at its edges. Raises ScenarioError."""
    table = file.table()
    try:
        width, depth, names = _extent(table)
        pitch_um = pitch_um or _pitch_um(table, max(width, depth))
        nx, ny = (math.ceil(side / pitch_um - 1e-6) + 2 * EMPTY_CELLS for side in (width, depth))
        if reason := memory_error(BYTES_OF_A_CELL * nx * ny):
            found = f"a grid of {nx} x {ny} cells of {pitch_um:g} µm {reason}"
            raise PartError([f"file: {found}; {_too_wide(file, width, depth)}"])
        grid = Grid(nx=nx, ny=ny, pitch_um=pitch_um)
        solid = table.solid(grid, Path())
    except PartError as error:
        raise ScenarioError(str(file.path), error.errors) from error
    hangs = overhangs(solid.columns(nx, ny, grid.pitch)) is not None
    return FittedPart(grid, solid, (width, depth, solid.shape.height * UM_PER_M), names, hangs)


def _too_wide(file: PartFile, width: float, depth: float) -> str:
    """Advice if no grid for the part fits into memory; lengths in um."""
    unit = f" if its unit is {ASSUMED_UNIT}, which is assumed" if file.assumes_unit else ""
    sides = f"{width * MM_PER_M / UM_PER_M:g} x {depth * MM_PER_M / UM_PER_M:g} mm"
    return f"the part is {sides} wide{unit}; correct --unit, or take a larger --pitch-um"


def mesh_of_scenario(path: Path) -> tuple[Body, ...] | None:
    """The bodies of a scenario whose part is a mesh, as it places them; None for any other, and for one with errors."""
    try:
        raw = tomlkit.parse(path.read_text(encoding="utf-8")).unwrap()
        table, grid = MeshTable.model_validate(raw["part"]), Grid.model_validate(raw["grid"])
        return table.placed(read_bodies(path.parent / table.file, table.unit), grid)
    except (OSError, UnicodeDecodeError, TOMLKitError, KeyError, ValidationError, GeometryError, PartError):
        return None  # reported, where it is an error, with all others of the scenario


def expected_layers(height: float) -> int:
    """Full layers of the default ink in a height [m]."""
    ink: Ink = ScenarioFile.model_fields["ink"].default.a.ink
    return math.ceil(height / ink.layer_height - ROUNDING)


def _pitch_um(table: MeshTable | LayersTable | HeightMapTable, side: float) -> float:
    """That of the layers, else the first that shows a part of that longer side [um]. Raises PartError."""
    if isinstance(table, LayersTable):
        return table.manifest(Path()).pitch_x_um
    return next((pitch for pitch in PITCHES_UM if side >= CELLS_MIN * pitch), PITCHES_UM[-1])


def _extent(table: MeshTable | LayersTable | HeightMapTable) -> tuple[float, float, tuple[str, ...]]:
    """Width and depth of a part [um], and the names in its file. Raises PartError."""
    nowhere = Grid(nx=1, ny=1)
    if not isinstance(table, MeshTable):
        box = table.solid(nowhere, Path()).bounds
        return (box.x_max - box.x_min) / M_PER_UM, (box.y_max - box.y_min) / M_PER_UM, ()
    try:
        bodies = table.placed(read_bodies(table.file, table.unit), nowhere)
    except GeometryError as error:
        raise PartError([f"file: {error}"]) from error
    low, high = bounds(bodies)
    width, depth = (float(side) for side in (high - low)[:2] / M_PER_UM)
    return width, depth, tuple(dict.fromkeys(body.name or body.material for body in bodies))
