"""`[part]` of pictures: a stack of slices, one picture for each layer, and a map of heights."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from inkloop.errors import HeightMapError
from inkloop.geometry import Columns
from inkloop.geometry.layer_runs import columns_of_layers
from inkloop.metrology import map_folder_options as options
from inkloop.metrology.cell_means import cell_means
from inkloop.metrology.file_names import name_errors, numbered_files
from inkloop.metrology.height_map import HeightMap
from inkloop.metrology.map_file import read
from inkloop.metrology.registration import Registration
from inkloop.tables.shapes import Grid, Length, PlacedTable, Position
from inkloop.tables.solid import Bounds, PartError, Solid
from inkloop.units import M_PER_UM

NUMBER = "n"
"""Field of a file name that holds the number of a slice."""
INKS = {"none": 0, "A": 1, "B": 2}
EDGE = 1e-6
"""Share of the pitch within which a wall counts as being on the centres of cells."""
_LISTED = 5
Grey = Annotated[str, Field(pattern=r"^\d{1,10}$")]
Labels = NDArray[np.int8]


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
        pages = _Pages(self, grid, self._center(grid))
        try:
            columns, *by_ink = columns_of_layers(
                pages.labels(self._files(folder)), grid.nx, grid.ny, grid.pitch, self.layer_um * M_PER_UM, labels=2
            )
        except HeightMapError as error:
            raise PartError([f"files: {error}"]) from error
        except OSError as error:
            raise PartError([f"files: {error.filename} cannot be read: {error.strerror or error}"]) from error
        of_a, of_b = by_ink
        return Solid(columns, pages.bounds(), of_a if of_b.mask.any() else None, tuple(pages.remarks()))

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


class _Pages:
    """Reads the slices of a stack; `bounds` and `remarks` are of use when all are read."""

    def __init__(self, table: StackTable, grid: Grid, center: tuple[float, float]) -> None:
        self._table, self._grid, self._center = table, grid, center
        self._known = {int(grey): INKS[ink] for grey, ink in table.inks.items()}
        self._first = ""
        self._shape: tuple[int, ...] = ()
        self._filled = [np.zeros(0, np.bool_), np.zeros(0, np.bool_)]

    def labels(self, paths: list[Path]) -> Iterator[Labels]:
        """(nx, ny) of each slice: 0 none, 1 ink A, 2 ink B. Raises PartError, HeightMapError, OSError."""
        from inkloop.metrology.picture_file import grey_pages

        for path in paths:
            for number, page in enumerate(grey_pages(path), start=1):
                place = path.name if len(paths) > 1 or number == 1 else f"{path.name}, page {number}"
                labels = self._labelled(place, page)
                labels = labels.T if self._table.rows_along == "x" else labels
                labels = labels[:: -1 if self._table.mirror == "x" else 1, :: -1 if self._table.mirror == "y" else 1]
                self._note(place, labels)
                i, j = (self._pixels(axis) for axis in (0, 1))
                slice_ = labels[np.ix_(i.clip(0, labels.shape[0] - 1), j.clip(0, labels.shape[1] - 1))]
                off = [(k < 0) | (k >= count) for k, count in zip((i, j), labels.shape, strict=True)]
                yield np.where(off[0][:, None] | off[1], np.int8(0), slice_)

    def bounds(self) -> Bounds:
        """The box around the filled pixels."""
        edges: list[float] = []
        for axis, filled in enumerate(self._filled):
            used = np.flatnonzero(filled)
            first, last = (int(used[0]), int(used[-1]) + 1) if used.size else (0, 0)
            edges += [self._start(axis) + first * self._pixel, self._start(axis) + last * self._pixel]
        return Bounds(*edges)

    def remarks(self) -> Iterator[str]:
        """A sentence for each direction in which centres of cells lie between two pixels."""
        for axis, name in enumerate("xy"):
            position = self._positions(axis)
            if np.any(np.abs(position - np.round(position)) * self._pixel < EDGE * self._grid.pitch):
                yield (
                    f"along {name}, centres of cells lie between two pixels, which rounding decides; shift the part by "
                    f"a fraction of a pixel (center_{name}_um)"
                )

    @property
    def _pixel(self) -> float:
        return self._table.pixel_um * M_PER_UM

    def _start(self, axis: int) -> float:
        """Where the pictures begin on the grid [m]."""
        return self._center[axis] - self._shape[axis] / 2 * self._pixel

    def _positions(self, axis: int) -> NDArray[np.float64]:
        """Centres of the cells, in pixels from the first edge."""
        count = (self._grid.nx, self._grid.ny)[axis]
        return np.asarray((np.arange(count) * self._grid.pitch - self._start(axis)) / self._pixel, np.float64)

    def _pixels(self, axis: int) -> NDArray[np.intp]:
        return np.floor(self._positions(axis)).astype(np.intp)

    def _labelled(self, place: str, page: NDArray[np.generic]) -> Labels:
        """Inks instead of grey values. Raises PartError."""
        labels = np.full(page.shape, -1, np.int8)
        for grey, ink in self._known.items():
            labels[page == grey] = ink
        unknown = np.argwhere(labels < 0)
        if unknown.size:
            row, column = (int(index) for index in unknown[0])
            raise PartError(
                [
                    f"inks has no grey value {page[row, column]}, which {place} has first in row {row}, column "
                    f"{column}; {len(unknown):,} pixels of it have unknown values, known are "
                    f"{', '.join(map(str, self._known))}; add it to inks, or save the pictures without smoothing"
                ]
            )
        return labels

    def _note(self, place: str, labels: Labels) -> None:
        """Check the size of a slice and widen the box around what is filled. Raises PartError."""
        if not self._first:
            self._first, self._shape = place, labels.shape
            self._filled = [np.zeros(count, np.bool_) for count in labels.shape]
        if labels.shape != self._shape:
            sizes = [" x ".join(map(str, shape)) for shape in (labels.shape, self._shape)]
            raise PartError(
                [
                    f"files: {place} has {sizes[0]} pixels along x and y, {self._first} has {sizes[1]}; "
                    "save all slices in one size"
                ]
            )
        for axis in (0, 1):
            self._filled[axis] |= labels.any(axis=1 - axis)


class HeightMapTable(PlacedTable):
    """`[part]` with `shape = "height-map"`: solid from the substrate up to the heights in a file."""

    shape: Literal["height-map"]
    file: str = Field(description="height map, relative to the scenario, in any format that MapFolder reads")
    unit: options.Unit = None
    pixel_um: options.Pixel = None
    count_scale: options.CountScale = None
    invalid_value: options.InvalidValue = None
    rows_along: options.RowsAlong = None
    mirror: options.Mirrored = "none"
    rotation_deg: options.Rotation = 0.0
    valid_share_min: options.ValidShareMin = 0.5
    base_um: Position = Field(default=0.0, description="added to every height")

    def solid(self, grid: Grid, folder: Path) -> Solid:
        """The part on the grid: on each cell up to the mean of its pixels. Raises PartError."""
        try:
            map_ = read(
                folder / self.file,
                unit=self.unit,
                pixel=None if self.pixel_um is None else self.pixel_um * M_PER_UM,
                scale=self.count_scale,
                invalid_value=self.invalid_value,
                rows_along=self.rows_along,
            )
            registration = self._registration(map_, grid)
            parts = max(1, math.ceil(max(map_.dx, map_.dy) / grid.pitch))
            cells = cell_means(_divided(map_, parts), registration, grid.nx, grid.ny, grid.pitch)
        except HeightMapError as error:
            raise PartError([f"file: {error}"]) from error
        top = np.where(cells.valid(self.valid_share_min), cells.mean + self.base_um * M_PER_UM, 0.0).ravel()
        cell = np.arange(grid.nx * grid.ny)
        columns = Columns.of_intervals(grid.nx, grid.ny, grid.pitch, cell, np.zeros(cell.size), top)
        return Solid(columns, _bounds(map_, registration, -self.base_um * M_PER_UM))

    def _registration(self, map_: HeightMap, grid: Grid) -> Registration:
        """Puts the middle of the map on the centre of the part."""
        turned = Registration(rotation=math.radians(self.rotation_deg), mirror=self.mirror)
        middle = (np.array((count - 1) / 2 * size) for count, size in zip(map_.shape, (map_.dx, map_.dy), strict=True))
        x, y = turned.to_grid(*middle)
        center_x, center_y = self._center(grid)
        return Registration(center_x - float(x), center_y - float(y), turned.rotation, mirror=self.mirror)


def _divided(map_: HeightMap, parts: int) -> HeightMap:
    """The same surface in parts x parts finer pixels for each of its pixels."""
    if parts == 1:
        return map_
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
