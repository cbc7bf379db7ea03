"""Values of a job under the parameter names of FMUs; regions as height intervals of each cell."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.component import Job
from inkloop.fmu import FmuDescription, Variable
from inkloop.fmu_writer.export import INTERVALS, INTERVALS_MAX
from inkloop.geometry import Columns, cell_centers
from inkloop.units import conversion

EDGE_M = 1.0  # replaces an infinite end; a bottom above its top marks an empty interval
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
    """factor: number of the job to number of the FMU; None where the name has another meaning in the FMU."""
    is_length = name in _LENGTHS or name.startswith(("h1_", "h2_", "h3_", "region_bottom", "region_top"))
    is_other_type = name == "pass_order" and not variable.items
    return None if is_other_type else conversion("m" if is_length else "1", variable.unit)


def region_parameters(
    description: FmuDescription, job: Job, asked: object
) -> tuple[dict[str, NDArray[np.float64]], dict[str, int], list[str]]:
    """The region of ink A as parameters of an FMU, the size that makes room for it, and the errors.

    asked: the number of intervals that the options give, if they do.
    """
    if job.region is None:
        return {}, {}, []
    columns = Columns.of_shape(job.region, job.nx, job.ny, job.pitch)
    most, begins = int(columns.counts.max()), description.default_sizes.get(INTERVALS)
    if begins is None:
        limit = room = description.variables["region_bottom"].shape({})[0]
        remedy = f"inkloop export fmu {description.name} --intervals {most} writes one that has"
    elif isinstance(asked, int):
        limit = room = asked
        remedy = f"leave {INTERVALS} out, and the FMU gets as many as the region needs"
    else:
        limit, room, remedy = INTERVALS_MAX, begins, "take 'LayerMpc'"
    if most > limit:
        found = f"the region of ink A has {most} intervals of height on a cell"
        return {}, {}, [f"kind is {description.name!r}: {found}, this FMU has room for {limit} ({INTERVALS}); {remedy}"]
    if room > INTERVALS_MAX:
        return {}, {}, [f"{INTERVALS} is {room}; expected 1 to {INTERVALS_MAX}"]
    count = max(most, room)
    return region_maps(columns, count), {} if begins is None else {INTERVALS: count}, []


def region_maps(columns: Columns, count: int) -> dict[str, NDArray[np.float64]]:
    """`region_bottom` and `region_top`, each (count, nx, ny) [m]: exactly the heights that a region contains.

    An interval that a cell lacks comes last and has its bottom above its top. count: at least the most of a cell.
    """
    found = columns.intervals(*cell_centers(columns.nx, columns.ny, columns.pitch))
    shape = columns.nx, columns.ny
    none = np.full(shape, np.inf), np.full(shape, -np.inf)
    edges = np.array([*found, *[none] * (count - len(found))]).clip(-EDGE_M, EDGE_M)
    return {"region_bottom": edges[:, 0], "region_top": edges[:, 1]}
