"""Which ink belongs on which cell in the coming layer (Lu, Zheng, Mishra 2015, IV-B)."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from inkloop.component import FloatMap, Job
from inkloop_controller.core import IntMap

RegionTest: TypeAlias = Literal["middle", "surface"]
"""Where a cell is asked for its ink: half a layer above the surface, or on it, as the paper has it. The middle halves
the error of the printed geometry."""


def materials(job: Job, height: FloatMap, test: RegionTest) -> IntMap:
    """(nx, ny) index of the ink that belongs on each cell of a surface `height` [m]: 0 in the region, 1 elsewhere."""
    if job.region is None:
        return np.zeros((job.nx, job.ny), np.int32)
    above = nominal_layer_height(job) / 2 if test == "middle" else 0.0
    x, y = np.meshgrid(np.arange(job.nx) * job.pitch, np.arange(job.ny) * job.pitch, indexing="ij")
    return np.where(job.region.contains(x, y, height + above), 0, 1).astype(np.int32)


def nominal_layer_height(job: Job) -> float:
    """Height of a full layer [m]; where the job has a region, the mean over its inks."""
    inks = job.inks if job.region is not None else job.inks[:1]
    return sum(ink.layer_height for ink in inks) / len(inks)
