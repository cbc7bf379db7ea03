"""Values of a job under the parameter names of FMUs; regions as height intervals of each cell."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap, Geometry, Job
from inkloop.fmu import Variable
from inkloop.geometry import cell_centers
from inkloop.units import conversion

INTERVALS = 2  # on a cell, at most: the walls of a pipe
SAMPLES_PER_LAYER = 4  # what is thinner is not seen (assumed)
EDGE_M = 1.0  # stands for no end; above its top for nowhere
_LENGTHS = frozenset({"pitch", "target_height", "height_start"})


def parameters_from_job(job: Job) -> dict[str, Any]:
    """Values of the job in SI by the names of parameters."""
    inks = {
        f"h{order}_{letter}": getattr(ink, f"h{order}")
        for letter, ink in zip("ab", job.inks, strict=False)
        for order in (1, 2, 3)
    }
    names = ("nx", "ny", "pitch", "target_height", "mask", "passes", "pass_order", "pass_rotation", "seed")
    surface = {} if job.height_start is None else {"height_start": job.height_start}
    ground = {"flat_ground": job.height_start is None}
    return {name: getattr(job, name) for name in names} | inks | surface | ground


def ink_parameters(job: Job) -> dict[str, Any]:
    """Values of the job for an FMU that chooses between inks. Raises ValueError as `region_intervals`."""
    return {"inks": len(job.inks), "has_region": job.region is not None, **region_intervals(job)}


def factor_from_job(name: str, variable: Variable) -> float | None:
    """From the job's number to the FMU's; None where the FMU means something else by the name."""
    is_length = name in _LENGTHS or name.startswith(("h1_", "h2_", "h3_", "region_bottom_", "region_top_"))
    is_other_type = name == "pass_order" and not variable.items
    return None if is_other_type else conversion("m" if is_length else "1", variable.unit)


def region_intervals(job: Job) -> dict[str, FloatMap]:
    """`region_bottom_1`, `region_top_1`, ... (nx, ny) [m]: exactly the heights that `job.region` contains on each cell.

    An interval that a cell lacks has its bottom above its top. Raises ValueError if a cell has more than INTERVALS.
    """
    region = job.region
    if region is None:
        return {}
    heights = _samples(job)
    x, y = cell_centers(job.nx, job.ny, job.pitch)
    inside = np.stack([region.contains(x, y, np.full_like(x, z)) for z in heights])
    before, after = np.zeros_like(inside), np.zeros_like(inside)
    before[1:], after[:-1] = inside[:-1], inside[1:]
    begins, ends = inside & ~before, inside & ~after
    most = int(begins.sum(axis=0).max())
    if most > INTERVALS:
        raise ValueError(f"the region has {most} intervals of height on a cell; needs at most {INTERVALS}")
    found = {}
    for k in range(1, INTERVALS + 1):
        found[f"region_bottom_{k}"] = _edges(region, job, heights, begins & (begins.cumsum(axis=0) == k), -1)
        found[f"region_top_{k}"] = _edges(region, job, heights, ends & (ends.cumsum(axis=0) == k), 1)
    return found


def _samples(job: Job) -> NDArray[np.float64]:
    """Heights from below the substrate to above all that is printed [m]."""
    layer = max(ink.layer_height for ink in job.inks)
    step = min(ink.layer_height for ink in job.inks) / SAMPLES_PER_LAYER
    return np.arange(-2.0 * layer, float(job.target_height.max()) + 10.0 * layer, step)


def _edges(region: Geometry, job: Job, heights: NDArray[np.float64], at: NDArray[np.bool_], outward: int) -> FloatMap:
    """(nx, ny) the last height inside, going `outward` from the sample that is marked, `at` (samples, nx, ny)."""
    edges = np.where(at.any(axis=0), outward * EDGE_M, -outward * EDGE_M)
    sample, i, j = np.nonzero(at)
    is_closed = (sample + outward >= 0) & (sample + outward < len(heights))
    sample, i, j = sample[is_closed], i[is_closed], j[is_closed]
    x, y = (centers[i, j] for centers in cell_centers(job.nx, job.ny, job.pitch))
    inner, outer = heights[sample], heights[sample + outward]
    while True:
        middle = 0.5 * (inner + outer)
        if ((middle == inner) | (middle == outer)).all():  # no double lies between
            edges[i, j] = inner
            return edges
        is_inside = region.contains(x, y, middle)
        inner, outer = np.where(is_inside, middle, inner), np.where(is_inside, outer, middle)
