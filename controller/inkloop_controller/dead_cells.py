"""Cells whose droplets do not come, told from the growth of the print itself."""

from __future__ import annotations

import numpy as np

from inkloop.component import FloatMap
from inkloop_controller.core import checked, pointer
from inkloop_controller.core_library import library

DEAD_EVIDENCE = 15.0  # from here on a cell is dead (controller/core/dead_cells.h)
PROBE_LAYERS = 5  # every so many layers the dead cells are tried again (assumed)


def dead_evidence(before: FloatMap, own: FloatMap, grown: FloatMap, variance: FloatMap, part_cells: int) -> FloatMap:
    """(nx, ny) logarithm of how much likelier nothing comes than a weak droplet [1]; from DEAD_EVIDENCE on a cell is
    dead (Wald 1945; Page 1954: never below 0).

    before: the same after the last layer; own: what the cell's droplet was to leave on it [m], 0 where there was none
    or nobody saw it: such a layer says nothing, nor does one in which most of the part got nothing; grown: what the
    neighbours' droplets do not explain of its growth [m], with its variance [m^2]; part_cells: number of cells of the
    part.
    """
    shape, after = np.shape(before), np.empty(np.shape(before))
    names = {"before": before, "own": own, "grown": grown, "variance": variance}
    maps = [checked(name, array, "f8", shape) for name, array in names.items()]
    library().inkloop_dead_evidence(after.size, *(pointer(array) for array in maps), part_cells, pointer(after))
    return after


def is_probe(layer: int) -> bool:
    """Whether dead cells are tried again in layer number `layer`: a nozzle may have been cleaned."""
    return layer % PROBE_LAYERS == 0
