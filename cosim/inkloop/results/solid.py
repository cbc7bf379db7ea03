"""The printed solid in two inks: the ink at each place, and the share that is in the region of the other ink."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap, Ink, Job
from inkloop.geometry import cell_centers
from inkloop.results.attributes import variable

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
    height = run.height.values
    top = max(float(height[-1].max()), float(run.target_height.max()))
    middles = _middles(int(np.ceil(top / STEP_M)))
    solid = np.zeros((*height.shape[1:], middles.size), np.int8)
    for layer, filling in enumerate(run.ink.values[1:]):
        below, above = (surface[..., None] for surface in height[layer : layer + 2])
        solid += filling[..., None] * ((middles >= below) & (middles < above))
    return solid


def with_solid(run: xr.Dataset, job: Job) -> xr.Dataset:
    """The run of a job in two inks with `ink` (layer, x, y), see `layer_inks`, and the scalar `mismatch`.

    mismatch: voxels of ink A where it is not wanted plus wanted ones without it, as a share of the wanted ones.
    """
    if job.region is None or not {"height", "pattern"} <= run.keys():
        return run
    ink = np.concatenate([np.zeros((1, job.nx, job.ny), np.int8), layer_inks(run.pattern.values[1:], job.inks)])
    filled = run.assign(ink=variable("ink", ("layer", "x", "y"), ink, "1"))
    printed = voxels(filled)[job.mask] == 1
    x, y = (axis[job.mask][:, None] for axis in cell_centers(job.nx, job.ny, job.pitch))
    middles, top = _middles(printed.shape[1]), job.target_height[job.mask][:, None]
    wanted = job.region.contains(x, y, middles) & (middles <= top)
    share = float((printed ^ wanted).sum()) / max(1.0, float(wanted.sum()))
    return filled.assign(mismatch=variable("mismatch", (), share, "1"))


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
