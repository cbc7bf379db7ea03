"""Permitted droplets of each cell: ink of the region, drop sizes of the head, dead nozzles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal, TypeAlias

import numpy as np

from inkloop.component import BoolMap, Job
from inkloop_controller.problem.horizon_problem import KINDS_MAX
from inkloop_controller.problem.options import declared, default, errors_of, refuse

RegionTest: TypeAlias = Literal["middle", "surface", "either"]
"""Where a cell is asked for its ink: half a layer above the surface; on it, as the paper has it; or at both ends of the
layer, either ink being right where they differ. The middle halves the error of the printed geometry."""


class DropletChoices:
    """Which droplets may fall on a cell: of the ink of its region, in the sizes of the head, from nozzles that jet.

    drop_levels: largest level; dead_nozzles: nozzles that jet nothing, of nozzle_pitch in all: cell (i, j) is jetted by
    nozzle j modulo nozzle_pitch (0: as many nozzles as the grid has columns).
    Raises ValueError, all errors in one sentence, for invalid values.
    """

    def __init__(
        self,
        job: Job,
        *,
        region_test: Annotated[RegionTest, declared("region_test")] = default("region_test"),
        drop_levels: Annotated[int, declared("drop_levels")] = default("drop_levels"),
        dead_nozzles: Annotated[Sequence[int], declared("dead_nozzles")] = (),
        nozzle_pitch: Annotated[int, declared("nozzle_pitch")] = default("nozzle_pitch"),
    ) -> None:
        nozzles = nozzle_pitch or job.ny
        errors = errors_of(region_test=region_test, nozzle_pitch=nozzle_pitch)
        if job.mask.shape != (job.nx, job.ny):
            errors.append(f"mask has shape {job.mask.shape}; needs {(job.nx, job.ny)}")
        if not 1 <= drop_levels * len(job.inks) <= KINDS_MAX:
            errors.append(
                f"drop_levels is {drop_levels} with {len(job.inks)} inks; needs 1 to {KINDS_MAX // len(job.inks)}"
            )
        errors += [
            f"dead_nozzles has {nozzle}; needs nozzles 0 to {nozzles - 1}"
            for nozzle in dead_nozzles
            if not 0 <= nozzle < nozzles
        ]
        refuse(errors)
        alive = ~np.isin(np.arange(job.ny) % nozzles, list(dead_nozzles))
        self.region_test, self.drop_levels = region_test, drop_levels
        self.jettable: BoolMap = job.mask & alive
