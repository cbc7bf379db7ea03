"""`[part]` of layers for a print head, read by their manifest."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from inkloop.errors import GeometryError, HeightMapError, require
from inkloop.files import reason_of
from inkloop.geometry.layer_runs import Labels
from inkloop.tables import layer_manifest
from inkloop.tables.layer_manifest import Manifest
from inkloop.tables.part_images import INKS
from inkloop.tables.shapes import Grid, Length, PlacedTable
from inkloop.tables.slices import Slices
from inkloop.tables.solid import PartError, Solid
from inkloop.units import M_PER_UM


class LayersTable(PlacedTable):
    """`[part]` with `shape = "layers"`: bitmaps of `inkloop export layers` as slices from the substrate up."""

    shape: Literal["layers"]
    file: str = Field(description="`manifest.json` in the folder of the bitmaps, relative to the scenario")
    layer_um: Length | None = Field(
        default=None, description="height of a slice; none: a full layer of the ink, as the manifest has it"
    )

    def solid(self, grid: Grid, folder: Path) -> Solid:
        """The part on the grid. Raises PartError."""
        path = folder / self.file
        manifest = self.manifest(folder)
        pixel = manifest.pitch_x_um * M_PER_UM, manifest.pitch_y_um * M_PER_UM
        thickness = self._layer_um(manifest) * M_PER_UM
        try:
            solid = Slices(grid, self._center(grid), pixel).solid(_labelled(path, manifest), thickness)
        except HeightMapError as error:
            raise PartError([f"file: {error}"]) from error
        except OSError as error:
            raise PartError([f"file: {error.filename} cannot be read: {reason_of(error)}"]) from error
        return replace(solid, remarks=(*solid.remarks, *_remarks(manifest)))

    def manifest(self, folder: Path) -> Manifest:
        """The manifest, with its bitmaps as they were written. Raises PartError."""
        try:
            return layer_manifest.read(folder / self.file)
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
