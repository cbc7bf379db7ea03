"""`[part]` of pictures: a stack of slices, one picture for each layer, and a map of heights."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from inkloop.errors import HeightMapError, require
from inkloop.geometry import Columns
from inkloop.limits import memory_error
from inkloop.metrology import map_folder_options as options
from inkloop.metrology.folder_watch import name_errors, numbered_files
from inkloop.metrology.height_map import HeightMap
from inkloop.metrology.map_file import read
from inkloop.metrology.registration import Registration, cell_means
from inkloop.tables.shapes import Bounds, Grid, Length, PartError, PlacedTable, Position, Solid
from inkloop.tables.slices import Labels, Slices
from inkloop.units import M_PER_UM, UM_PER_M

NUMBER = "n"
"""Field of a file name that holds the number of a slice."""
INKS = {"none": 0, "A": 1, "B": 2}
BYTES_OF_A_PIXEL = 24
"""Memory of a pixel of a divided map: its height, and copies of it."""
_LISTED = 5
Grey = Annotated[str, Field(pattern=r"^\d{1,10}$")]


class StackTable(PlacedTable):
    """`[part]` with `shape = "stack"`: slices from the substrate up, each a picture of grey values."""

    shape: Literal["stack"]
    files: str = Field(
        description="file name of a slice, relative to the scenario: PNG, TIFF or BMP, with its number as "
        '"layer_{n:04d}.png"; without one, a TIFF whose pages are the slices'
    )
    layer_um: Length = Field(description="height of a slice")
    pixel_um: Length = Field(description="pixel spacing; a cell takes the pixel in which its centre is")
    rows_along: Literal["x", "y"] = Field(default="x", description='"x": a stored row lies along x')
    mirror: options.Mirrored = "none"
    inks: dict[Grey, Literal["none", "A", "B"]] = Field(
        default={"0": "none", "1": "A", "2": "B"}, description="ink of each grey value"
    )

    def solid(self, grid: Grid, folder: Path) -> Solid:
        """The part on the grid. Raises PartError."""
        slices = Slices(grid, self._center(grid), (self.pixel_um * M_PER_UM,) * 2)
        try:
            return slices.solid(_labelled(self, self._files(folder)), self.layer_um * M_PER_UM)
        except HeightMapError as error:
            raise PartError([f"files: {error}"]) from error
        except OSError as error:
            raise PartError([f"files: {error.filename} cannot be read: {error.strerror or error}"]) from error

    def _files(self, folder: Path) -> list[Path]:
        """The files in order. Raises PartError, OSError."""
        place, name = (folder / self.files).parent, Path(self.files).name
        if "{" not in name:
            return [place / name]
        if errors := name_errors("files", name, NUMBER, "layer_{n:04d}.png"):
            raise PartError(errors)
        found = numbered_files(place, name, NUMBER)
        if not found:
            raise PartError([f"files is {self.files!r}: no file in {place.absolute()} has such a name; correct it"])
        missing = sorted(set(range(min(found), max(found) + 1)) - set(found))
        if missing:
            shown = ", ".join(map(str, missing[:_LISTED])) + (", ..." if len(missing) > _LISTED else "")
            raise PartError(
                [
                    f"files is {self.files!r}: {len(missing)} of the slices {min(found)} to {max(found)} are missing: "
                    f"{shown}; add them, or number the slices without a gap"
                ]
            )
        return [found[number] for number in sorted(found)]


def _labelled(table: StackTable, paths: Sequence[Path]) -> Iterator[tuple[str, Labels]]:
    """Every slice with its place: (pixels along x, along y), 0 none, 1 ink A, 2 ink B.

    Raises PartError, HeightMapError, OSError.
    """
    require("PIL", "a picture of a layer", HeightMapError)
    from inkloop.metrology.picture_file import grey_pages

    known = {int(grey): INKS[ink] for grey, ink in table.inks.items()}
    for path in paths:
        for number, page in enumerate(grey_pages(path), start=1):
            place = path.name if len(paths) > 1 or number == 1 else f"{path.name}, page {number}"
            labels = _inks_of(known, place, page)
            labels = labels.T if table.rows_along == "x" else labels
            yield place, labels[:: -1 if table.mirror == "x" else 1, :: -1 if table.mirror == "y" else 1]


def _inks_of(known: Mapping[int, int], place: str, page: NDArray[np.generic]) -> Labels:
    """Inks instead of grey values. Raises PartError."""
    labels = np.full(page.shape, -1, np.int8)
    for grey, ink in known.items():
        labels[page == grey] = ink
    unknown = np.argwhere(labels < 0)
    if unknown.size:
        row, column = (int(index) for index in unknown[0])
        raise PartError(
            [
                f"inks has no grey value {page[row, column]}, which {place} has first in row {row}, column "
                f"{column}; {len(unknown):,} pixels of it have unknown values, known are "
                f"{', '.join(map(str, known))}; add it to inks, or save the pictures without smoothing"
            ]
        )
    return labels


class HeightMapTable(PlacedTable):
    """`[part]` with `shape = "height-map"`: solid from the substrate up to the heights in a file."""

    shape: Literal["height-map"]
    file: str = Field(description="height map, relative to the scenario, in any format that MapFolder reads")
    unit: options.Unit = None
    pixel_um: options.Pixel = None
    count_scale: options.CountScale = None
    invalid_value: options.InvalidValue = None
    rows_along: options.RowsAlong = None
    channel: options.Channel = None
    mirror: options.Mirrored = "none"
    rotation_deg: options.Rotation = 0.0
    valid_share_min: options.ValidShareMin = 0.5
    base_um: Position = Field(default=0.0, description="added to every height")

    def read(self, folder: Path) -> HeightMap:
        """The map. Raises PartError."""
        try:
            return read(
                folder / self.file,
                unit=self.unit,
                pixel=None if self.pixel_um is None else self.pixel_um * M_PER_UM,
                scale=self.count_scale,
                invalid_value=self.invalid_value,
                rows_along=self.rows_along,
                channel=self.channel,
            )
        except HeightMapError as error:
            raise PartError([f"file: {error}"]) from error

    def solid(self, grid: Grid, folder: Path, map_: HeightMap | None = None) -> Solid:
        """The part on the grid: on each cell up to the mean of its pixels. Raises PartError.

        map_: that of the file, where it is at hand.
        """
        map_ = map_ or self.read(folder)
        registration = self._registration(map_, grid)
        try:
            cells = cell_means(_divided(map_, grid.pitch), registration, grid.nx, grid.ny, grid.pitch)
        except HeightMapError as error:
            raise PartError([f"file: {error}"]) from error
        top = np.where(cells.valid(self.valid_share_min), cells.mean + self.base_um * M_PER_UM, 0.0).ravel()
        cell = np.arange(grid.nx * grid.ny)
        columns = Columns.of_intervals(grid.nx, grid.ny, grid.pitch, cell, np.zeros(cell.size), top)
        height = map_.z + self.base_um * M_PER_UM
        volume = float(height[height > 0.0].sum()) * map_.dx * map_.dy
        return Solid(columns, _bounds(map_, registration, -self.base_um * M_PER_UM), volume=volume)

    def _registration(self, map_: HeightMap, grid: Grid) -> Registration:
        """Puts the middle of the map on the centre of the part."""
        turned = Registration(rotation=math.radians(self.rotation_deg), mirror=self.mirror)
        middle = (np.array((count - 1) / 2 * size) for count, size in zip(map_.shape, (map_.dx, map_.dy), strict=True))
        x, y = turned.to_grid(*middle)
        center_x, center_y = self._center(grid)
        return Registration(center_x - float(x), center_y - float(y), turned.rotation, mirror=self.mirror)


def _divided(map_: HeightMap, pitch: float) -> HeightMap:
    """The same surface in pixels that are not larger than a cell. Raises PartError."""
    pixel = max(map_.dx, map_.dy)
    parts = max(1, math.ceil(pixel / pitch))
    if parts == 1:
        return map_
    if reason := memory_error(BYTES_OF_A_PIXEL * map_.z.size * float(parts) ** 2):
        found = f"a pixel is {pixel * UM_PER_M:.6g} µm, a cell {pitch * UM_PER_M:.6g} µm: dividing it {reason}"
        raise PartError([f"file: {found}; correct pixel_um or unit, or take a larger pitch"])
    z = np.repeat(np.repeat(map_.z, parts, axis=0), parts, axis=1)
    dx, dy = map_.dx / parts, map_.dy / parts
    return HeightMap(z, dx, dy, (dx - map_.dx) / 2, (dy - map_.dy) / 2, map_.source)


def _bounds(map_: HeightMap, registration: Registration, lowest: float) -> Bounds:
    """The box around the pixels higher than `lowest` [m]."""
    i, j = np.nonzero(map_.z > lowest)
    if not i.size:
        return Bounds(0.0, 0.0, 0.0, 0.0)
    x, y = registration.to_grid(map_.dx * i.astype(np.float64), map_.dy * j.astype(np.float64))
    across, along = (np.abs(registration.matrix) @ (map_.dx, map_.dy)) / 2
    return Bounds(float(x.min() - across), float(x.max() + across), float(y.min() - along), float(y.max() + along))
