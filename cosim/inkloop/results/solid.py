"""The printed solid in two inks: the ink at each place, and where it is not the ink that is wanted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inkloop.component import FloatMap, Ink, Job
from inkloop.geometry import cell_centers

if TYPE_CHECKING:
    import xarray as xr

INK = "ink"
STEP_M = 1e-6  # height of a voxel: a droplet brings several times that (assumed)
_BYTES_AT_ONCE = 1 << 28


def layer_ink(pattern: ArrayLike, inks: Sequence[Ink]) -> NDArray[np.int8]:
    """(nx, ny): the ink that fills most of what a layer adds to each cell: 1 A, 2 B, 0 nothing near.

    pattern: (nx, ny), 0 none, 1 A, 2 B. Shares are those of the flat surface, where a cell's own droplet brings more
    than all its neighbours together.
    """
    drops = np.asarray(pattern)
    shares = [_shares(drops == number, ink) for number, ink in enumerate(inks, start=1)]
    filled = np.argmax(shares, axis=0) + 1
    return np.where(np.max(shares, axis=0) > 0.0, filled, 0).astype(np.int8)


def voxels(run: xr.Dataset) -> NDArray[np.int8]:
    """(nx, ny, levels): the ink at the middle of each voxel of STEP_M up to the target or the top, 0 above the surface.

    run: dataset with height, target_height and ink.
    """
    return _filled(run.height.values, run.ink.values, _levels(run.height[-1].values, run.target_height.values))


def mismatch(height: Any, ink: Any, job: Job) -> float:
    """Voxels of ink A where it is not wanted plus wanted ones without it, as a share of the wanted ones.

    height, ink: (layers, nx, ny) as in a run, arrays or variables of a file, of which some rows at a time are read.
    """
    assert job.region is not None
    levels = _levels(np.asarray(height[-1]), job.target_height)
    x, y = cell_centers(job.nx, job.ny, job.pitch)
    rows = max(1, _BYTES_AT_ONCE // (job.ny * (6 * levels + 9 * height.shape[0])))
    differing, wanted = 0, 0
    for first in range(0, job.nx, rows):
        block = slice(first, first + rows)
        part = job.mask[block]
        printed = _filled(np.asarray(height[:, block]), np.asarray(ink[:, block]), levels)[part] == 1
        middles, top = _middles(levels), job.target_height[block][part][:, None]
        asked = job.region.contains(x[block][part][:, None], y[block][part][:, None], middles) & (middles <= top)
        differing += int((printed ^ asked).sum())
        wanted += int(asked.sum())
    return differing / max(1, wanted)


def region_edges(job: Job) -> dict[str, FloatMap]:
    """`region_bottom` and `region_top`, each (intervals, nx, ny) [m]: the heights between which ink A is wanted.

    NaN where a cell has fewer intervals; nothing for a job in one ink.
    """
    if job.region is None:
        return {}
    edges = np.array(job.region.intervals(*cell_centers(job.nx, job.ny, job.pitch)))
    edges = np.where(edges[:, :1] <= edges[:, 1:], edges, np.nan)
    return {"region_bottom": edges[:, 0], "region_top": edges[:, 1]}


def wanted(run: xr.Dataset) -> NDArray[np.bool_]:
    """(nx, ny, levels): the voxels, as those of `voxels`, in which the part is to have ink A."""
    middles = _middles(_levels(run.height[-1].values, run.target_height.values))
    below = (middles <= run.target_height.values[..., None]) & run.mask.values.astype(bool)[..., None]
    inside: NDArray[np.bool_] = np.zeros(below.shape, np.bool_)
    for bottom, top in zip(run.region_bottom.values, run.region_top.values, strict=True):
        inside |= (bottom[..., None] <= middles) & (middles <= top[..., None])
    inside &= below
    return inside


def ink_error(run: xr.Dataset, reach_m: float = 15e-6) -> FloatMap:
    """(nx, ny, levels) [m]: how much ink A is missing (positive) or too much (negative) at the surface of the print.

    It is the height of the run of voxels, along z, that lack ink A or have it where it is not wanted; given to all
    voxels within `reach_m` of that run, 0 elsewhere.
    """
    from scipy.ndimage import maximum_filter1d  # a quarter of a second that other reports need not wait

    printed, expected = voxels(run) == 1, wanted(run)
    size = 2 * round(reach_m / STEP_M) + 1
    missing, excess = (
        maximum_filter1d(_run_lengths(wrong), size, axis=2) for wrong in (expected & ~printed, printed & ~expected)
    )
    return np.asarray(np.where(missing >= excess, missing, -excess) * STEP_M)


def _run_lengths(marks: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Each marked voxel with the number of marked ones in its run along z, 0 elsewhere."""
    lengths = np.zeros(marks.shape, np.float32)
    framed = np.diff(np.pad(marks, ((0, 0), (0, 0), (1, 1))).astype(np.int8), axis=2)
    ends = zip(np.argwhere(framed == 1), np.argwhere(framed == -1), strict=True)
    for (i, j, first), (_, _, after) in ends:
        lengths[i, j, first:after] = after - first
    return lengths


def _levels(top_surface: FloatMap, target: FloatMap) -> int:
    return int(np.ceil(max(float(top_surface.max()), float(target.max())) / STEP_M))


def _filled(height: FloatMap, ink: NDArray[np.int8], levels: int) -> NDArray[np.int8]:
    middles = _middles(levels)
    solid = np.zeros((*height.shape[1:], levels), np.int8)
    for layer, filling in enumerate(ink[1:]):
        below, above = (surface[..., None] for surface in height[layer : layer + 2])
        solid += filling[..., None] * ((middles >= below) & (middles < above))
    return solid


def _middles(levels: int) -> FloatMap:
    return np.asarray((np.arange(levels) + 0.5) * STEP_M, np.float64)


def _shares(droplets: NDArray[np.bool_], ink: Ink) -> FloatMap:
    """(nx, ny) height that the droplets of one ink bring to each cell of a flat surface [m]."""
    framed = np.pad(droplets, 1)
    nx, ny = droplets.shape
    spread = {0: ink.h1, 1: ink.h2, 2: ink.h3}
    total = np.zeros(droplets.shape)
    for di in (-1, 0, 1):
        for dj in (-1, 0, 1):
            total += spread[abs(di) + abs(dj)] * framed[1 + di : 1 + di + nx, 1 + dj : 1 + dj + ny]
    return total
