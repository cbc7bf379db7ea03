"""`[part]` of layers for a print head, and their `manifest.json`, which `inkloop export layers` writes."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from inkloop.errors import GeometryError, HeightMapError, require
from inkloop.files import reason_of, regular
from inkloop.tables.messages import sentence
from inkloop.tables.part_images import INKS
from inkloop.tables.shapes import Grid, Length, PartError, PlacedTable, Solid
from inkloop.tables.slices import Labels, Slices
from inkloop.units import M_PER_UM

NAME = "manifest.json"
FORMAT = "inkloop layers"
FORMAT_VERSION = 1
ORIGIN = "x = 0, y = 0 is the centre of the first pixel of the first row"
FIRST_ROW = "y = 0; rows follow along +y"
FIRST_COLUMN = "x = 0; columns follow along +x"
POLARITY = "a set bit is a droplet, shown black; a clear bit is none, shown white"
_LISTED = 3
_READ = ConfigDict(frozen=True, strict=True, defer_build=True)  # other keys are for people, and for other programs


class ManifestFile(BaseModel):
    """Keys read from the entry of a bitmap."""

    model_config = _READ

    file: Annotated[str, Field(pattern=r"^[^/\\\x00]+$")] = Field(description="its name, in the folder of the manifest")
    layer: int = Field(ge=1)
    ink: Literal["A", "B"]
    sha256: str


class ManifestInk(BaseModel):
    """Keys read from the entry of an ink."""

    model_config = _READ

    layer_height_um: Length


class Manifest(BaseModel):
    """Keys read from a manifest, all of them checked: bitmaps of another orientation are another part."""

    model_config = _READ

    format: Literal["inkloop layers"]
    format_version: Literal[1]
    width_pixels: int = Field(ge=1)
    height_pixels: int = Field(ge=1)
    pitch_x_um: Length
    pitch_y_um: Length
    origin: str
    first_row: str
    first_column: str
    polarity: str
    drop_levels: int = Field(ge=1)
    unknown_layers: list[int] = []
    inks: dict[Literal["A", "B"], ManifestInk]
    files: list[ManifestFile] = Field(min_length=1)

    def layers(self) -> list[list[ManifestFile]]:
        """The bitmaps of each layer, of all passes and inks."""
        layers: list[list[ManifestFile]] = [[] for _ in range(max(one.layer for one in self.files))]
        for one in self.files:
            layers[one.layer - 1].append(one)
        return layers


def read(path: Path) -> Manifest:
    """The manifest at `path`, whose bitmaps are there unchanged. Raises GeometryError with all errors."""
    try:
        manifest = Manifest.model_validate(json.loads(regular(path).read_bytes()))
    except OSError as error:
        raise GeometryError(f"{path}: cannot be read: {reason_of(error)}") from error
    except ValidationError as error:
        found = "; ".join(sentence(detail, Manifest) for detail in error.errors()[:_LISTED])
        raise GeometryError(f"{path}: is no manifest of `inkloop export layers`: {found}") from error
    except (ValueError, RecursionError) as error:
        raise GeometryError(f"{path}: is not JSON ({error}); name the {NAME} of a folder of layers") from error
    if errors := [*_other_conventions(manifest), *_gaps(manifest), *_changed_files(path.parent, manifest)]:
        raise GeometryError(f"{path}: " + "; ".join(errors))
    return manifest


def _other_conventions(manifest: Manifest) -> Iterator[str]:
    known = {"origin": ORIGIN, "first_row": FIRST_ROW, "first_column": FIRST_COLUMN, "polarity": POLARITY}
    for key, expected in known.items():
        if (found := getattr(manifest, key)) != expected:
            yield f"{key} is {found!r}; expected {expected!r}: turn or invert the bitmaps, then say so here"
    if manifest.drop_levels > 1:
        yield (
            f"drop_levels is {manifest.drop_levels}: drops of several sizes make no slice of one height; "
            "export layers of single drops"
        )
    if unknown := sorted({one.ink for one in manifest.files} - set(manifest.inks)):
        yield f"files are of ink {', '.join(unknown)}, which inks lacks; add it with its layer_height_um"


def _gaps(manifest: Manifest) -> Iterator[str]:
    numbers = {one.layer for one in manifest.files}
    missing = next(number for number in count(1) if number not in numbers)
    if missing < max(numbers):
        yield f"has layer {max(numbers)}, but not layer {missing}; a part needs all of them from layer 1"


def _changed_files(folder: Path, manifest: Manifest) -> Iterator[str]:
    wrong = []
    for one in manifest.files:
        try:
            found = hashlib.sha256(regular(folder / one.file).read_bytes()).hexdigest()
        except OSError as error:
            wrong.append(f"{one.file} cannot be read: {reason_of(error)}")
            continue
        if found != one.sha256:
            wrong.append(f"{one.file} was changed: its SHA-256 is {found[:12]}..., not {one.sha256[:12]}...")
    yield from wrong[:_LISTED]
    if len(wrong) > _LISTED:
        yield f"{len(wrong)} of {len(manifest.files)} files are missing or were changed: export the layers again"


class LayersTable(PlacedTable):
    """`[part]` with `shape = "layers"`: bitmaps of `inkloop export layers` as slices from the substrate up."""

    shape: Literal["layers"]
    file: str = Field(description="`manifest.json` in the folder of the bitmaps, relative to the scenario")
    layer_um: Length | None = Field(
        default=None, description="height of a slice; none: a full layer of the ink, as the manifest has it"
    )

    def solid(self, grid: Grid, folder: Path, manifest: Manifest | None = None) -> Solid:
        """The part on the grid; manifest: that of the file, where it is at hand. Raises PartError."""
        path, manifest = folder / self.file, manifest or self.read(folder)
        pixel = manifest.pitch_x_um * M_PER_UM, manifest.pitch_y_um * M_PER_UM
        thickness = self._layer_um(manifest) * M_PER_UM
        try:
            solid = Slices(grid, self._center(grid), pixel).solid(_labelled(path, manifest), thickness)
        except HeightMapError as error:
            raise PartError([f"file: {error}"]) from error
        except OSError as error:
            raise PartError([f"file: {error.filename} cannot be read: {reason_of(error)}"]) from error
        return replace(solid, remarks=(*solid.remarks, *_remarks(manifest)))

    def read(self, folder: Path) -> Manifest:
        """The manifest, with its bitmaps as they were written. Raises PartError."""
        try:
            return read(folder / self.file)
        except GeometryError as error:
            raise PartError([f"file: {error}"]) from error

    def _layer_um(self, manifest: Manifest) -> float:
        heights = {manifest.inks[one.ink].layer_height_um for one in manifest.files}
        if self.layer_um is None and len(heights) > 1:
            shown = " and ".join(f"{height:g}" for height in sorted(heights))
            raise PartError([f"layer_um is missing: full layers of the inks are {shown} µm; give that of a slice"])
        return self.layer_um or heights.pop()


def _labelled(path: Path, manifest: Manifest) -> Iterator[tuple[str, Labels]]:
    """Every slice with its place: (nx, ny), 0 none, 1 ink A, 2 ink B. Raises PartError, HeightMapError, OSError.

    path: of the manifest.
    """
    for number, files in enumerate(manifest.layers(), start=1):
        labels = np.zeros((manifest.width_pixels, manifest.height_pixels), np.int8)
        for one in files:
            bits = _bits(path, one.file, manifest)
            if (labels[bits] > 0).any():
                i, j = (int(index[0]) for index in np.nonzero(bits & (labels > 0)))
                place = f"column {i}, row {j}"
                found = f"{one.file} has a droplet in {place}, as another file of layer {number}"
                raise PartError([f"file: {path.name}: {found}; export the layers again"])
            labels[bits] = INKS[one.ink]
        yield f"layer {number}", labels


def _bits(path: Path, file: str, manifest: Manifest) -> NDArray[np.bool_]:
    """(nx, ny), True for a droplet in a file next to the manifest. Raises PartError, HeightMapError, OSError."""
    require("PIL", "a picture of a layer", HeightMapError)
    from inkloop.metrology.picture_file import grey_pages

    page = next(grey_pages(path.with_name(file)))
    shape = manifest.height_pixels, manifest.width_pixels
    if page.shape != shape or page.max(initial=0) > 1:
        found = f"{file} has {page.shape[1]} x {page.shape[0]} pixels with values up to {page.max(initial=0)}"
        expected = f"expected {shape[1]} x {shape[0]} of one bit"
        raise PartError([f"file: {path.name}: {found}; {expected}: export the layers again"])
    return np.asarray(page.T == 1)


def _remarks(manifest: Manifest) -> Iterator[str]:
    if manifest.unknown_layers:
        shown = ", ".join(map(str, manifest.unknown_layers))
        yield f"layer {shown} of the run was aborted; the part has it as it was commanded"
