"""Which ink belongs on which cell in the coming layers (Lu, Zheng, Mishra 2015, IV-B)."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from inkloop.component import BoolMap, FloatMap, Job
from inkloop_controller.core.bindings import IntMap

RegionTest: TypeAlias = Literal["middle", "surface", "either"]
"""Where a cell is asked for its ink: half a layer above the surface; on it, as the paper has it; or at both ends of the
layer, either ink being right where they differ. The middle halves the error of the printed geometry."""


def materials(job: Job, height: FloatMap, test: RegionTest) -> IntMap:
    """(nx, ny) index of the ink that belongs on each cell of a surface `height` [m]: 0 in the region, 1 elsewhere."""
    return np.where(ink_choices(job, height, 1, test)[0] & 1, 0, 1).astype(np.int32)


def ink_choices(job: Job, height: FloatMap, layers: int, test: RegionTest) -> IntMap:
    """(layers, nx, ny): 1 where ink A belongs, 2 where B, 3 where either, in each of the coming layers.

    Over the horizon the surface is taken to rise by a nominal layer at a time from `height` [m], wherever the droplets
    then fall: the sets of a later layer do not depend on the plan, which keeps the problem one of droplets alone.
    """
    if job.region is None:
        return np.ones((layers, job.nx, job.ny), np.int32)
    step = nominal_layer_height(job)
    choices = np.empty((layers, job.nx, job.ny), np.int32)
    for ahead in range(layers):
        bottom = height + ahead * step
        if test == "either":
            below, above = _in_region(job, bottom), _in_region(job, bottom + step)
            choices[ahead] = np.where(below == above, np.where(below, 1, 2), 3)
        else:
            choices[ahead] = np.where(_in_region(job, bottom + (step / 2 if test == "middle" else 0.0)), 1, 2)
    return choices


def nominal_layer_height(job: Job) -> float:
    """Height of a full layer [m]; where the job has a region, the mean over its inks."""
    inks = job.inks if job.region is not None else job.inks[:1]
    return sum(ink.layer_height for ink in inks) / len(inks)


def _in_region(job: Job, z: FloatMap) -> BoolMap:
    assert job.region is not None
    x, y = np.meshgrid(np.arange(job.nx) * job.pitch, np.arange(job.ny) * job.pitch, indexing="ij")
    return job.region.contains(x, y, z)
