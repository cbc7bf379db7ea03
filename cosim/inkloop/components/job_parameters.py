"""Values of a job under the parameter names of FMUs; regions as height intervals of each cell."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.component import Job
from inkloop.fmu import Variable
from inkloop.geometry import Columns, cell_centers
from inkloop.units import conversion

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
    """Values of the job for an FMU that chooses between inks, but for the region of ink A."""
    return {"inks": len(job.inks), "has_region": job.region is not None}


def factor_from_job(name: str, variable: Variable) -> float | None:
    """From the job's number to the FMU's; None where the FMU means something else by the name."""
    is_length = name in _LENGTHS or name.startswith(("h1_", "h2_", "h3_", "region_bottom", "region_top"))
    is_other_type = name == "pass_order" and not variable.items
    return None if is_other_type else conversion("m" if is_length else "1", variable.unit)


def region_columns(job: Job) -> Columns | None:
    """The region of ink A over the cells of the job."""
    return None if job.region is None else Columns.of_shape(job.region, job.nx, job.ny, job.pitch)


def region_maps(columns: Columns, count: int) -> dict[str, NDArray[np.float64]]:
    """`region_bottom` and `region_top`, each (count, nx, ny) [m]: exactly the heights that a region contains.

    An interval that a cell lacks comes last and has its bottom above its top. count: at least the most of a cell.
    """
    found = columns.intervals(*cell_centers(columns.nx, columns.ny, columns.pitch))
    shape = columns.nx, columns.ny
    none = np.full(shape, np.inf), np.full(shape, -np.inf)
    edges = np.array([*found, *[none] * (count - len(found))]).clip(-EDGE_M, EDGE_M)
    return {"region_bottom": edges[:, 0], "region_top": edges[:, 1]}
