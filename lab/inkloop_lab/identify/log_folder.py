"""Read a print logged by other software: a folder with a pattern and a height map per layer and a print.toml.

print.toml            pitch_um = 263.256, unit = "um", pixel_um = 5.0, ...
pattern_0001.csv      what was jetted in layer 1: 0 none, 1 material A, 2 material B, one number per cell
layer_0000.csv        the start surface;  layer_0001.csv: after layer 1, ...
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from inkloop.component import FloatMap
from inkloop.contract import PassOrder
from inkloop.errors import HeightMapError
from inkloop.files import TomlError, read_toml_text, toml_tables
from inkloop.limits import filled
from inkloop.metrology.datum import Datum
from inkloop.metrology.height_map import HeightMap, Mirror
from inkloop.metrology.map_file import read
from inkloop.metrology.registration import Registration, cell_means
from inkloop.tables.messages import sentence
from inkloop.tables.shapes import Length, Position, Table
from inkloop.units import M_PER_UM
from inkloop_lab.identify.print_record import IdentificationError, PrintRecord

DESCRIPTION = "print.toml"
LAYERS_MOST = 100_000


class PrintTable(Table):
    """`print.toml`. A file name holds `{layer}`; the suffix sets the format."""

    pitch_um: Length = Field(description="droplet spacing")
    patterns: str = Field(default="pattern_{layer:04d}.csv", description="names of the patterns, from layer 1 on")
    maps: str = Field(default="layer_{layer:04d}.csv", description="names of the height maps, from layer 0 on")
    unit: Literal["nm", "um", "mm", "m"] | None = Field(default=None, description="of the heights")
    pixel_um: Length | None = Field(default=None, description="distance of two pixels; the pitch for one per cell")
    count_scale: Length | None = Field(default=None, description="height of one count, in the unit")
    invalid_value: Position | None = Field(default=None, description="what marks a pixel without a height")
    rows_along: Literal["x", "y"] | None = Field(default=None, description="of patterns and maps")
    offset_x_um: Position = 0.0
    offset_y_um: Position = 0.0
    rotation_deg: Position = 0.0
    mirror: Mirror = "none"
    valid_share_min: Annotated[float, Field(gt=0.0, le=1.0)] = 0.5
    datum: Datum = Field(default="none", description="what the cells that no droplet reached show is taken off")
    middle_share: Annotated[float, Field(gt=0.0, le=1.0)] = Field(
        default=1.0,
        description="side of the square in the middle of a cell that counts; 1: the whole cell",
    )
    inked_um: Length | None = Field(default=None, description="height over the start plane from where a pixel is ink")
    passes: Literal[1, 4] = 1
    pass_order: Literal["raster", "diagonal"] = "raster"
    pass_rotation: int = Field(default=0, ge=0, le=3)


def is_log(folder: Path) -> bool:
    """Whether a folder holds the log of a print."""
    return (folder / DESCRIPTION).is_file()


def read_log(folder: Path) -> PrintRecord:
    """The print of a folder. Raises IdentificationError with everything that is wrong with it."""
    table = _table(folder)
    patterns, errors = _patterns(folder, table)
    if errors:
        raise IdentificationError(_list(folder, errors))
    nx, ny = patterns[0].shape
    maps = _Maps(folder, table, nx, ny)
    found, areas, ground = [], [], 0.0
    for layer in range(len(patterns) + 1):
        try:
            map_ = maps.read(layer)
            found.append(maps.heights(map_))
            if layer == 0:
                ground = float(np.nanmedian(map_.z))
            areas.append(maps.covered(map_, ground))
        except HeightMapError as error:
            errors.append(str(error))
    if errors:
        raise IdentificationError(_list(folder, errors))
    record = PrintRecord(
        str(folder),
        table.pitch_um * M_PER_UM,
        np.stack(patterns),
        np.stack(found),
        np.stack(areas) if table.inked_um is not None else None,
        table.passes,
        PassOrder[table.pass_order.upper()].value,
        table.pass_rotation,
    )
    try:
        return record.levelled(table.datum)
    except HeightMapError as error:
        raise IdentificationError(f"{folder}: {error}") from error


def _table(folder: Path) -> PrintTable:
    path = folder / DESCRIPTION
    try:
        raw = toml_tables(read_toml_text(path))
        table = PrintTable.model_validate(raw)
    except OSError as error:
        raise IdentificationError(f"{path}: cannot be read: {error.strerror}") from error
    except TomlError as error:
        raise IdentificationError(f"{path}: {error}") from error
    except ValidationError as error:
        raise IdentificationError(_list(path, [sentence(detail, PrintTable) for detail in error.errors()])) from error
    errors = [
        f"{key} is {name!r}; expected a name with the number in it: {PrintTable.model_fields[key].default!r}"
        for key, name in (("patterns", table.patterns), ("maps", table.maps))
        if not _is_numbered(name)
    ]
    if errors:
        raise IdentificationError(_list(path, errors))
    return table


def _is_numbered(name: str) -> bool:
    try:
        return filled(name, {"layer": 1}) != filled(name, {"layer": 2})
    except ValueError:
        return False


def _patterns(folder: Path, table: PrintTable) -> tuple[list[NDArray[np.int32]], list[str]]:
    """The patterns of layers 1, 2, ... as far as there are files, and their errors."""
    found: list[NDArray[np.int32]] = []
    errors: list[str] = []
    for layer in range(1, LAYERS_MOST):
        path = folder / filled(table.patterns, {"layer": layer})
        if not path.is_file():
            break
        pattern = _pattern(path, table.rows_along, errors)
        if found and pattern.shape != found[0].shape:
            errors.append(f"{path.name}: has {pattern.shape} cells, the first pattern {found[0].shape}")
        found.append(pattern)
    if not found:
        errors.append(f"{filled(table.patterns, {'layer': 1})} is not there; log what was jetted, or correct patterns")
    return found, errors


def _pattern(path: Path, rows_along: str | None, errors: list[str]) -> NDArray[np.int32]:
    """The pattern in one file; its errors are appended to `errors`."""
    try:
        is_array = path.suffix.lower() == ".npy"
        values = (
            np.load(path, allow_pickle=False) if is_array else np.loadtxt(path, delimiter=_delimiter(path), ndmin=2)
        )
    except (OSError, ValueError) as error:
        errors.append(f"{path.name}: cannot be read as a table of numbers: {str(error).splitlines()[0]}")
        return np.zeros((1, 1), np.int32)
    if values.ndim != 2 or not np.isin(values, (0, 1, 2)).all():
        wrong = values[~np.isin(values, (0, 1, 2))]
        problem = f"holds {wrong.flat[0]:g}" if wrong.size else f"holds an array of shape {values.shape}"
        errors.append(f"{path.name}: {problem}; expected rows and columns of 0, 1 and 2")
        return np.zeros((1, 1), np.int32)
    along_x = (rows_along or ("y" if is_array else "x")) == "x"
    return np.ascontiguousarray(values.T if along_x else values, dtype=np.int32)


def _delimiter(path: Path) -> str | None:
    """The separator of the numbers in a text file; None: white space."""
    text = path.read_text(encoding="utf-8", errors="replace")
    return next((mark for mark in (";", "\t", ",") if mark in text), None)


@dataclass(frozen=True)
class _Maps:
    """The height maps of a folder on the grid of its patterns."""

    folder: Path
    table: PrintTable
    nx: int
    ny: int

    def read(self, layer: int) -> HeightMap:
        """The map after a layer. Raises HeightMapError."""
        table = self.table
        reading: dict[str, Any] = {"unit": table.unit, "scale": table.count_scale, "invalid_value": table.invalid_value}
        pixel = None if table.pixel_um is None else table.pixel_um * M_PER_UM
        path = self.folder / filled(table.maps, {"layer": layer})
        map_ = read(path, pixel=pixel, rows_along=table.rows_along, **reading)
        if not map_.valid.any():
            raise HeightMapError(f"{path}: no pixel of it was measured")
        return map_

    def heights(self, map_: HeightMap) -> FloatMap:
        """(nx, ny) [m]: mean of each cell or its middle, NaN where too little was measured. Raises HeightMapError."""
        height = self._means(map_)
        if not np.isfinite(height).any():
            raise HeightMapError(
                f"{map_.source}: shows no cell of the grid of {self.nx} x {self.ny}; correct offset_x_um, offset_y_um, "
                "rotation_deg, mirror or pixel_um"
            )
        return height

    def covered(self, map_: HeightMap, ground: float) -> FloatMap:
        """(nx, ny): share of each cell's pixels that are ink (Wu, Chiu 2024, eq. 14)."""
        threshold = math.inf if self.table.inked_um is None else ground + self.table.inked_um * M_PER_UM
        inked = np.where(map_.valid, (map_.z > threshold).astype(np.float64), np.nan)
        return np.nan_to_num(self._means(HeightMap(inked, map_.dx, map_.dy, map_.x0, map_.y0, map_.source), 1.0))

    def _means(self, map_: HeightMap, share: float | None = None) -> FloatMap:
        table, pitch = self.table, self.table.pitch_um * M_PER_UM
        middle = table.middle_share if share is None else share
        placed = Registration(
            table.offset_x_um * M_PER_UM,
            table.offset_y_um * M_PER_UM,
            math.radians(table.rotation_deg),
            mirror=table.mirror,
        )
        parts = max(1, 2 * round((1.0 / middle - 1.0) / 2.0) + 1)  # the middle one of so many along each side
        fine = cell_means(map_, _finer(placed, parts, pitch), self.nx * parts, self.ny * parts, pitch / parts)
        return np.where(fine.valid(table.valid_share_min), fine.mean, np.nan)[parts // 2 :: parts, parts // 2 :: parts]


def _finer(placed: Registration, parts: int, pitch: float) -> Registration:
    """The same place counted from the centre of the first of the parts of a cell."""
    shift = (pitch - pitch / parts) / 2.0
    return Registration(placed.offset_x + shift, placed.offset_y + shift, placed.rotation, placed.mirror)


def _list(place: Path, errors: list[str]) -> str:
    count = "1 error" if len(errors) == 1 else f"{len(errors)} errors"
    return "\n".join([f"{place}: {count}", *(f"  - {error}" for error in errors)])
