"""The printed solid in two inks: the ink at each place, and where it is not the ink that is wanted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap, Ink, Job
from inkloop.geometry import cell_centers

if TYPE_CHECKING:
    import xarray as xr

STEP_M = 1e-6  # height of a voxel: a droplet brings several times that (assumed)


def layer_inks(pattern: NDArray[np.int32], inks: Sequence[Ink]) -> NDArray[np.int8]:
    """(layers, nx, ny): the ink that fills most of what each layer adds to each cell: 1 A, 2 B, 0 nothing near.

    pattern: (layers, nx, ny), 0 none, 1 A, 2 B. Shares are those of the flat surface, where a cell's own droplet brings
    more than all its neighbours together.
    """
    shares = [_shares(pattern == number, ink) for number, ink in enumerate(inks, start=1)]
    filled = np.argmax(shares, axis=0) + 1
    return np.where(np.max(shares, axis=0) > 0.0, filled, 0).astype(np.int8)


def voxels(run: xr.Dataset) -> NDArray[np.int8]:
    """(nx, ny, levels): the ink at the middle of each voxel of STEP_M up to the target or the top, 0 above the surface.

    run: dataset with height, target_height and ink (see `with_solid`).
    """
    height, middles = run.height.values, _middles(_levels(run))
    solid = np.zeros((*height.shape[1:], middles.size), np.int8)
    for layer, filling in enumerate(run.ink.values[1:]):
        below, above = (surface[..., None] for surface in height[layer : layer + 2])
        solid += filling[..., None] * ((middles >= below) & (middles < above))
    return solid


def with_solid(run: xr.Dataset, job: Job) -> xr.Dataset:
    """The run of a job in two inks with `ink` (layer, x, y), see `layer_inks`, its region, and the scalar `mismatch`.

    region_bottom, region_top: (interval, x, y) heights between which ink A is wanted [m], NaN where there are fewer;
    mismatch: voxels of ink A where it is not wanted plus wanted ones without it, as a share of the wanted ones.
    """
    if job.region is None or not {"height", "pattern"} <= run.keys():
        return run
    ink = np.concatenate([np.zeros((1, job.nx, job.ny), np.int8), layer_inks(run.pattern.values[1:], job.inks)])
    words = "ink that fills most of what the layer added: 1 A, 2 B"
    filled = run.assign(ink=(("layer", "x", "y"), ink, {"units": "1", "long_name": words}))
    edges = np.array(job.region.intervals(*cell_centers(job.nx, job.ny, job.pitch)))
    edges = np.where(edges[:, :1] <= edges[:, 1:], edges, np.nan)
    for number, end in enumerate(("bottom", "top")):
        attributes = {"units": "m", "long_name": f"{end} of each interval of height in which ink A is wanted"}
        filled[f"region_{end}"] = (("interval", "x", "y"), edges[:, number], attributes)
    printed, expected = voxels(filled) == 1, wanted(filled)
    share = float((printed[job.mask] ^ expected[job.mask]).sum()) / max(1.0, float(expected[job.mask].sum()))
    words = "ink A too much or lacking, as a share of what is wanted"
    return filled.assign(mismatch=((), share, {"units": "1", "long_name": words}))


def wanted(run: xr.Dataset) -> NDArray[np.bool_]:
    """(nx, ny, levels): the voxels, as those of `voxels`, in which the part is to have ink A."""
    middles = _middles(_levels(run))
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


def _levels(run: xr.Dataset) -> int:
    """Voxels up to the target or the top, whichever is higher."""
    return int(np.ceil(max(float(run.height[-1].max()), float(run.target_height.max())) / STEP_M))


def _middles(levels: int) -> FloatMap:
    return np.asarray((np.arange(levels) + 0.5) * STEP_M, np.float64)


def _shares(droplets: NDArray[np.bool_], ink: Ink) -> FloatMap:
    """(layers, nx, ny) height that the droplets of one ink bring to each cell of a flat surface [m]."""
    framed = np.pad(droplets, ((0, 0), (1, 1), (1, 1)))
    nx, ny = droplets.shape[1:]
    spread = {0: ink.h1, 1: ink.h2, 2: ink.h3}
    total = np.zeros(droplets.shape)
    for di in (-1, 0, 1):
        for dj in (-1, 0, 1):
            total += spread[abs(di) + abs(dj)] * framed[:, 1 + di : 1 + di + nx, 1 + dj : 1 + dj + ny]
    return total
