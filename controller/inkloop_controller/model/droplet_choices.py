"""Permitted droplets of each cell: ink of the region, drop sizes of the head, dead nozzles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from inkloop.component import BoolMap, FloatMap, Ink, Job
from inkloop_controller.model.regions import InkRegions, RegionTest
from inkloop_controller.problem.horizon_problem import KINDS_MAX, ChoiceMaps, IntMap
from inkloop_controller.problem.options import Option

DEAD_NOZZLES = Option(
    meaning="nozzles that jet nothing and are excluded from the plans; neighbours still spill there. Cells that stay "
    "empty are also found during the print"
)
NOZZLE_PITCH = Option(
    meaning="nozzles of the head: cell (i, j) belongs to nozzle j modulo this number; 0: one for each column. Give "
    "the printer the same value"
)


class DropletChoices:
    """The kinds of droplets of a job, and where each may fall in the coming layers.

    A kind is an ink in a drop size: kind (level - 1) * inks + ink, where level droplets fall at once (grey heads).
    drop_levels: largest level; dead_nozzles: nozzles that jet nothing, of nozzle_pitch in all: cell (i, j) is jetted by
    nozzle j modulo nozzle_pitch (0: as many nozzles as the grid has columns).
    Raises ValueError, all errors in one sentence, for invalid values.
    """

    def __init__(
        self,
        job: Job,
        *,
        region_test: Annotated[RegionTest, Option()] = "middle",
        drop_levels: Annotated[int, Option()] = 1,
        dead_nozzles: Annotated[Sequence[int], DEAD_NOZZLES] = (),
        nozzle_pitch: Annotated[int, NOZZLE_PITCH] = 0,
    ) -> None:
        nozzles = nozzle_pitch or job.ny
        errors = []
        if job.mask.shape != (job.nx, job.ny):
            errors.append(f"mask has shape {job.mask.shape}; needs {(job.nx, job.ny)}")
        if not 1 <= drop_levels * len(job.inks) <= KINDS_MAX:
            errors.append(
                f"drop_levels is {drop_levels} with {len(job.inks)} inks; needs 1 to {KINDS_MAX // len(job.inks)}"
            )
        if nozzle_pitch < 0:
            errors.append(f"nozzle_pitch is {nozzle_pitch}; needs a number of nozzles, or 0 for one per column")
        errors += [
            f"dead_nozzles has {nozzle}; needs nozzles 0 to {nozzles - 1}"
            for nozzle in dead_nozzles
            if not 0 <= nozzle < nozzles
        ]
        if errors:
            raise ValueError("; ".join(errors))
        self._job, self._drop_levels = job, drop_levels
        self.regions = InkRegions(job, region_test)
        alive = ~np.isin(np.arange(job.ny) % nozzles, list(dead_nozzles))
        self.jettable: BoolMap = job.mask & alive

    def kinds(self, inks: Sequence[Ink]) -> tuple[Ink, ...]:
        """Height that a droplet of each kind adds, for these inks."""
        return tuple(
            Ink(level * ink.h1, level * ink.h2, level * ink.h3)
            for level in range(1, self._drop_levels + 1)
            for ink in inks
        )

    def allowed(self, height: FloatMap, layers: int) -> ChoiceMaps:
        """(layers, nx, ny): bit k is set where a droplet of kind k may fall, for the layers on the surface [m]."""
        inks = self.regions.choices(height, layers)
        levels = sum(1 << (level * len(self._job.inks)) for level in range(self._drop_levels))
        return np.where(self.jettable, inks * levels, 0).astype(np.uint16)

    def split(self, layer: IntMap) -> tuple[IntMap, IntMap]:
        """A layer of a plan (nx, ny) as pattern (0 none, 1 material A, 2 material B) and drops per site (0 none)."""
        inks = len(self._job.inks)
        jetted = layer > 0
        if self._drop_levels == 1:  # a layer is its own pattern: one map less
            return layer, jetted.astype(np.int32)
        pattern = np.where(jetted, (layer - 1) % inks + 1, 0).astype(np.int32)
        return pattern, np.where(jetted, (layer - 1) // inks + 1, 0).astype(np.int32)
