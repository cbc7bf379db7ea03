"""The maps of a run in a page: means of blocks of cells, in whole steps of 0.01 um, layer by layer.

A stack of layers goes into the page as differences from layer to layer in the smallest whole-number type that holds
them, deflated and in base64. Each height that the page shows differs from that of the block by half a step at most.
"""

from __future__ import annotations

import base64
import zlib
from itertools import count
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
BYTES_OF_A_CELL_AND_LAYER = 4
"""Height difference, droplets and planned droplets, before they are deflated."""
PLANNED = "planned_droplets"
TENTHS = 10
"""Planned droplets go into the page in tenths: means of blocks are no whole numbers."""
FINAL_CELLS = 1_000_000
"""Cells of all final error maps of a page at most."""
FINEST = 200
"""Ratio of the largest error of several runs to the smallest that has a scale of its own: smaller ones stay pale."""
_TYPES = (np.dtype("<i1"), np.dtype("<i2"), np.dtype("<i4"))
Whole = NDArray[np.int32]


def block_sums(values: NDArray[Any], block: int) -> FloatMap:
    """Sums over square blocks of `block` cells a side, which are smaller at the far edges."""
    along_x = np.add.reduceat(values, np.arange(0, values.shape[0], block), axis=0, dtype=np.float64)
    return np.asarray(np.add.reduceat(along_x, np.arange(0, values.shape[1], block), axis=1))


def block_means(values: FloatMap, block: int) -> FloatMap:
    """Means over such blocks, of the cells that have a number; NaN where none has."""
    counts = block_sums(np.isfinite(values), block)
    means: FloatMap = block_sums(np.nan_to_num(values), block) / np.where(counts > 0.0, counts, np.nan)
    return means


class Blocks:
    """Square blocks of `block` cells a side on a grid; at the far edges of the grid they may be smaller.

    shape: blocks along x and along y; part: blocks with cells of the part, whose `mask` is (nx, ny).
    """

    def __init__(self, mask: BoolMap, block: int) -> None:
        self.block = block
        self.part: BoolMap = self.sums(mask) > 0
        self.shape = self.part.shape
        nx, ny = mask.shape
        self._counted = mask | ~self.part.repeat(block, axis=0).repeat(block, axis=1)[:nx, :ny]
        self._cells = self.sums(self._counted)

    def sums(self, values: NDArray[Any]) -> FloatMap:
        """Sums over the cells of each block; values: (nx, ny)."""
        return block_sums(values, self.block)

    def means(self, values: FloatMap) -> FloatMap:
        """Means over the cells of each block, over those of the part if it has any: so the edge keeps its error."""
        return self.sums(np.where(self._counted, values, 0.0)) / self._cells


class LayerMaps:
    """Heights and droplets of a run by layer in blocks; `extend` adds the new layers of a dataset."""

    def __init__(self, run: xr.Dataset, block: int) -> None:
        self.blocks = Blocks(run["mask"].values.astype(bool), block)
        self.target: FloatMap = self.blocks.means(run["target_height"].values) * UM_PER_M
        self.step_um = step_um(run)
        self.heights: Whole = np.zeros((0, *self.blocks.shape), np.int32)
        self.droplets: NDArray[np.int8] = np.zeros((0, *self.blocks.shape), np.int8)
        self.planned = self.droplets
        self.extend(run)

    def extend(self, run: xr.Dataset) -> None:
        """Read the maps from the last known layer on, which may have been scanned since."""
        first = max(0, len(self.heights) - 1)
        heights, droplets, planned = (list(known[:first]) for known in (self.heights, self.droplets, self.planned))
        for layer in range(first, run.sizes["layer"]):
            height = run[HEIGHT][layer].values
            if np.isnan(height).any():  # jumped over, or not yet scanned
                heights.append(heights[-1] if heights else np.zeros(self.blocks.shape, np.int32))
            else:
                heights.append(np.rint(self.blocks.means(height) * (UM_PER_M / self.step_um)).astype(np.int32))
            droplets.append(self._droplets(run[PATTERN][layer].values if PATTERN in run else np.zeros(height.shape)))
            if PLANNED in run:
                means = self.blocks.sums(run[PLANNED][layer].values) / self.blocks.sums(np.ones(height.shape))
                planned.append(np.rint(TENTHS * means).astype(np.int8))
        self.heights, self.droplets, self.planned = np.array(heights), np.array(droplets), np.array(planned)

    def packed(self, first: int = 0) -> dict[str, Any]:
        """The layers from `first` on, for a page that has those before it."""
        before = self.heights[first - 1 : first] if first else np.zeros_like(self.heights[:1])
        return {
            "first": first,
            "heights": packed(np.diff(self.heights[first:], axis=0, prepend=before)),
            "droplets": packed(self.droplets[first:]),
            **({"planned": packed(self.planned[first:])} if self.planned.size else {}),
        }

    def described(self, run: xr.Dataset) -> dict[str, Any]:
        """Grid, target and part, which do not change while a run is printed; edges of blocks in mm, heights in um."""
        return {
            "block": self.blocks.block,
            "edges": edges(run, self.blocks.block),
            "pitch": float(run.attrs["pitch"]) * MM_PER_M,
            "step": self.step_um,
            "target": packed(self.target.astype("<f4")),
            "part": packed(self.blocks.part.astype(np.int8)),
        }

    @property
    def range_um(self) -> tuple[float, float]:
        """Least and greatest height of all layers and of the target, with the ground."""
        low, high = (float(end) * self.step_um for end in (self.heights.min(), self.heights.max()))
        return min(0.0, low, float(self.target.min())), max(1.0, high, float(self.target.max()))

    def _droplets(self, pattern: NDArray[Any]) -> NDArray[np.int8]:
        """Droplet of each cell, 0, 1 (A) or 2 (B); for larger blocks the share of cells with a droplet [%]."""
        if self.blocks.block == 1:
            return np.asarray(pattern, np.int8)
        shares = self.blocks.sums(pattern != 0) / self.blocks.sums(np.ones(pattern.shape))
        return np.asarray(np.rint(100.0 * shares), np.int8)


def step_um(run: xr.Dataset) -> float:
    """The step of the heights of a run: they fit into 32 bits."""
    return STEP_UM if float(run["target_height"].max()) * UM_PER_M < COARSE_FROM_UM else COARSE_STEP_UM


def final_errors(run: xr.Dataset, cells: float) -> dict[str, Any]:
    """Target minus final height over the part, in blocks of its own: at most `cells`, more than those of a layer."""
    blocks = Blocks(run["mask"].values.astype(bool), block_for(run, cells))
    error = blocks.means((run["target_height"] - run[HEIGHT][-1]).values) * (UM_PER_M / step_um(run))
    return {
        "edges": edges(run, blocks.block),
        "part": packed(blocks.part.astype(np.int8)),
        "errors": packed(np.rint(np.where(blocks.part, np.nan_to_num(error), 0.0)).astype(np.int32)),
    }


def edges(run: xr.Dataset, block: int) -> list[list[float]]:
    """Edges of blocks along x and along y [mm]; the centre of the first cell is at 0."""
    pitch = float(run.attrs["pitch"]) * MM_PER_M
    ends = [[*range(0, run.sizes[axis], block), run.sizes[axis]] for axis in "xy"]
    return [[round((end - 0.5) * pitch, 6) for end in each] for each in ends]


def block_for(run: xr.Dataset, cells: float) -> int:
    """The smallest side of blocks that are at most so many on the grid of a run."""
    nx, ny = run.sizes["x"], run.sizes["y"]
    return next(b for b in count(1) if -(-nx // b) * -(-ny // b) <= max(cells, 1.0))


def packed(values: NDArray[Any]) -> dict[str, Any]:
    """Maps (..., nx, ny) in rows along x, deflated (RFC 1950), in base64; whole numbers in the smallest type."""
    if values.dtype.kind in "iu":
        low, high = (int(values.min()), int(values.max())) if values.size else (0, 0)
        values = values.astype(next(t for t in _TYPES if np.iinfo(t).min <= low and high <= np.iinfo(t).max))
    rows = np.ascontiguousarray(values.swapaxes(-1, -2))
    data = base64.b64encode(zlib.compress(rows.tobytes())).decode("ascii")
    return {"type": values.dtype.name, "shape": rows.shape, "data": data}
