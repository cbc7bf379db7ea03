"""Which ink belongs on which cell in the coming layers (Lu, Zheng, Mishra 2015, IV-B)."""

from __future__ import annotations

from typing import Literal, TypeAlias, get_args

import numpy as np

from inkloop.component import FloatMap, Job
from inkloop.geometry import Columns
from inkloop_controller.core.bindings import IntMap, ink_choices

RegionTest: TypeAlias = Literal["middle", "surface", "either"]
"""Where a cell is asked for its ink: half a layer above the surface; on it, as the paper has it; or at both ends of the
layer, either ink being right where they differ. The middle halves the error of the printed geometry."""
_TESTS = get_args(RegionTest)


class InkRegions:
    """The ink of each cell of a job by its height: ink A in the job's region, B elsewhere; without a region A."""

    def __init__(self, job: Job, test: RegionTest) -> None:
        self._columns = None if job.region is None else Columns.of_shape(job.region, job.nx, job.ny, job.pitch)
        self._step, self._test = nominal_layer_height(job), 1 + _TESTS.index(test)

    def choices(self, height: FloatMap, layers: int) -> IntMap:
        """(layers, nx, ny): 1 where ink A belongs, 2 where B, 3 where either, in each of the coming layers.

        Over the horizon the surface is taken to rise by a nominal layer at a time from `height` [m], wherever the
        droplets then fall: the sets of a later layer do not depend on the plan, which keeps the problem one of droplets
        alone.
        """
        if self._columns is None:
            return np.ones((layers, *height.shape), np.int32)
        columns = self._columns
        return ink_choices(columns.offsets, columns.bottoms, columns.tops, height, layers, self._step, self._test)

    def materials(self, height: FloatMap) -> IntMap:
        """(nx, ny) index of the ink that belongs on each cell of a surface `height` [m]: 0 ink A, 1 ink B."""
        return np.where(self.choices(height, 1)[0] & 1, 0, 1).astype(np.int32)


def nominal_layer_height(job: Job) -> float:
    """Height of a full layer [m]; where the job has a region, the mean over its inks."""
    inks = job.inks if job.region is not None else job.inks[:1]
    return sum(ink.layer_height for ink in inks) / len(inks)
