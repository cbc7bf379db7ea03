"""Values of a job under the parameter names of FMUs; regions as height intervals of each cell."""

from __future__ import annotations

from typing import Any

import numpy as np

from inkloop.component import FloatMap, Job
from inkloop.fmu import Variable
from inkloop.geometry import cell_centers
from inkloop.units import conversion

INTERVALS = 2  # on a cell, at most: the walls of a pipe
EDGE_M = 1.0  # stands for no end; a bottom above its top for nowhere
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

    An interval that a cell lacks comes last and has its bottom above its top. Raises ValueError if a cell has more than
    INTERVALS.
    """
    if job.region is None:
        return {}
    none = np.full((job.nx, job.ny), np.inf), np.full((job.nx, job.ny), -np.inf)
    found = np.array([*job.region.intervals(*cell_centers(job.nx, job.ny, job.pitch)), *[none] * INTERVALS])
    is_empty = found[:, 0] > found[:, 1]
    most = int((~is_empty).sum(axis=0).max())
    if most > INTERVALS:
        raise ValueError(f"the region has {most} intervals of height on a cell; needs at most {INTERVALS}")
    edges = np.where(is_empty[:, None], np.array(none), found).clip(-EDGE_M, EDGE_M)
    edges = np.take_along_axis(edges, np.argsort(is_empty, axis=0, kind="stable")[:, None], axis=0)
    return {
        f"region_{end}_{1 + k}": edges[k, side] for k in range(INTERVALS) for side, end in enumerate(("bottom", "top"))
    }
