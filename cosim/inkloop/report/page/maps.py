"""The maps of a run in a page: means of blocks of cells, in whole steps of 0.01 um, layer by layer.

A stack of layers goes into the page as differences from layer to layer in the smallest whole-number type that holds
them, deflated and in base64. Each height that the page shows differs from that of the block by half a step at most.
"""

from __future__ import annotations

import base64
import zlib
from dataclasses import dataclass
from itertools import count
from math import prod
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from inkloop.component import BoolMap, FloatMap
from inkloop.contract import HEIGHT, PATTERN
from inkloop.units import MM_PER_M, UM_PER_M

STEP_UM, COARSE_STEP_UM = 0.01, 1.0
COARSE_FROM_UM = 20_000.0
"""Heights from which on steps of 0.01 um leave the range of 32 bits; steps are coarse for parts that high."""
BYTES_OF_A_CELL_AND_LAYER = 3
"""Height difference and droplets, before they are deflated."""
FINAL_CELLS = 1_000_000
"""Cells of all final error maps of a page at most."""
_TYPES = (np.dtype("<i1"), np.dtype("<i2"), np.dtype("<i4"))
Whole = NDArray[np.int32]


@dataclass(frozen=True)
class Blocks:
    """Square blocks of `block` cells a side on a grid; at the far edges of the grid they may be smaller."""

    nx: int
    ny: int
    block: int

    @property
    def shape(self) -> tuple[int, int]:
        """Blocks along x and along y."""
        return -(-self.nx // self.block), -(-self.ny // self.block)

    def sums(self, values: NDArray[Any]) -> NDArray[Any]:
        """Sums over the cells of each block; values: (..., nx, ny)."""
        if self.block == 1:
            return values
        starts = [np.arange(0, cells, self.block) for cells in (self.nx, self.ny)]
        return np.asarray(np.add.reduceat(np.add.reduceat(values, starts[0], axis=-2), starts[1], axis=-1))

    def spread(self, values: NDArray[Any]) -> NDArray[Any]:
        """The value of its block in each cell; values: of `shape`."""
        wide = np.repeat(np.repeat(values, self.block, axis=0), self.block, axis=1)
        return wide[: self.nx, : self.ny]


class PartMeans:
    """Means over blocks of cells; in a block that contains cells of the part, over those only.

    So errors on the edge of the part are those of the part. part: blocks that contain cells of it.
    """

    def __init__(self, mask: BoolMap, block: int) -> None:
        self.blocks = Blocks(mask.shape[0], mask.shape[1], block)
        self.part: BoolMap = self.blocks.sums(mask.astype(np.int64)) > 0
        counted = np.where(self.blocks.spread(self.part), mask, True).astype(np.float64)
        self._weights: FloatMap = counted / self.blocks.spread(self.blocks.sums(counted))

    def of(self, values: FloatMap) -> FloatMap:
        """The means of a map (nx, ny)."""
        return np.asarray(self.blocks.sums(values * self._weights))


class LayerMaps:
    """Heights and droplets of a run by layer in blocks; `extend` adds the new layers of a dataset."""

    def __init__(self, run: xr.Dataset, block: int) -> None:
        self._means = PartMeans(run["mask"].values.astype(bool), block)
        self.blocks, self.part = self._means.blocks, self._means.part
        self.target: FloatMap = self._means.of(run["target_height"].values) * UM_PER_M
        self.step_um = step_um(run)
        self.heights: Whole = np.zeros((0, *self.blocks.shape), np.int32)
        self.droplets: NDArray[np.int8] = np.zeros((0, *self.blocks.shape), np.int8)
        self.extend(run)

    def extend(self, run: xr.Dataset) -> None:
        """Read the maps from the last known layer on, which may have been scanned since."""
        first = max(0, len(self.heights) - 1)
        heights, droplets = list(self.heights[:first]), list(self.droplets[:first])
        for layer in range(first, run.sizes["layer"]):
            height = run[HEIGHT][layer].values
            if np.isnan(height).any():  # jumped over, or not yet scanned
                heights.append(heights[-1] if heights else np.zeros(self.blocks.shape, np.int32))
            else:
                heights.append(np.rint(self._means.of(height) * (UM_PER_M / self.step_um)).astype(np.int32))
            pattern = run[PATTERN][layer].values if PATTERN in run else np.zeros((self.blocks.nx, self.blocks.ny))
            droplets.append(self._droplets(pattern))
        self.heights, self.droplets = np.array(heights), np.array(droplets)

    def packed(self, first: int = 0) -> dict[str, Any]:
        """The layers from `first` on, for a page that has those before it."""
        before = self.heights[first - 1 : first] if first else np.zeros_like(self.heights[:1])
        return {
            "first": first,
            "heights": packed(np.diff(self.heights[first:], axis=0, prepend=before)),
            "droplets": packed(self.droplets[first:]),
        }

    def described(self, run: xr.Dataset) -> dict[str, Any]:
        """Grid, target and part, which do not change while a run is printed; lengths in mm, heights in um."""
        return {
            "grid": [self.blocks.nx, self.blocks.ny],
            "block": self.blocks.block,
            "shape": self.blocks.shape,
            "pitch_mm": float(run.attrs["pitch"]) * MM_PER_M,
            "step_um": self.step_um,
            "target": packed(self.target.astype("<f4")),
            "part": packed(self.part.astype(np.int8)),
        }

    def _droplets(self, pattern: NDArray[Any]) -> NDArray[np.int8]:
        """Droplet of each cell, 0, 1 (A) or 2 (B); for larger blocks the share of cells with a droplet [%]."""
        if self.blocks.block == 1:
            return np.asarray(pattern, np.int8)
        cells = self.blocks.sums(np.ones(pattern.shape))
        return np.asarray(np.rint(100.0 * self.blocks.sums((pattern != 0) * 1.0) / cells), np.int8)


def step_um(run: xr.Dataset) -> float:
    """The step of the heights of a run: they fit into 32 bits."""
    return STEP_UM if float(run["target_height"].max()) * UM_PER_M < COARSE_FROM_UM else COARSE_STEP_UM


def final_errors(run: xr.Dataset, cells: float) -> dict[str, Any]:
    """Target minus final height over the part, in blocks of its own: at most `cells`, more than those of a layer."""
    block = block_for(run, cells)
    means = PartMeans(run["mask"].values.astype(bool), block)
    error = means.of((run["target_height"] - run[HEIGHT][-1]).values) * (UM_PER_M / step_um(run))
    return {
        "block": block,
        "shape": means.blocks.shape,
        "part": packed(means.part.astype(np.int8)),
        "errors": packed(np.rint(np.where(means.part, np.nan_to_num(error), 0.0)).astype(np.int32)),
    }


def block_for(run: xr.Dataset, cells: float) -> int:
    """The smallest side of blocks that are at most so many on the grid of a run."""
    nx, ny = run.sizes["x"], run.sizes["y"]
    return next(b for b in count(1) if prod(Blocks(nx, ny, b).shape) <= max(cells, 1.0))


def packed(values: NDArray[Any]) -> dict[str, Any]:
    """An array for a page: whole numbers in the smallest type that holds them, deflated (RFC 1950), in base64."""
    if values.dtype.kind in "iu":
        low, high = (int(values.min()), int(values.max())) if values.size else (0, 0)
        values = values.astype(next(t for t in _TYPES if np.iinfo(t).min <= low and high <= np.iinfo(t).max))
    data = base64.b64encode(zlib.compress(np.ascontiguousarray(values).tobytes())).decode("ascii")
    return {"type": values.dtype.name, "shape": values.shape, "data": data}
