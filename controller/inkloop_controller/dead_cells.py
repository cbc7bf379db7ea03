"""Cells whose droplets do not come, told from the growth of the print itself."""

from __future__ import annotations

import numpy as np

from inkloop.component import FloatMap

WEAK = 0.5  # of a droplet's volume: the least that comes from a nozzle that is not dead (assumed)
LAYER_EVIDENCE = 5.0  # what one layer may say at most: a single droplet that failed is no dead nozzle (assumed)
DEAD_EVIDENCE = 15.0  # three layers of it; by chance less than once in a million cells (Wald 1945: exp -15)
WHOLE_HEAD = 0.5  # of the part: where more brings nothing in one layer, the ink has run out, no nozzle (assumed)
PROBE_LAYERS = 5  # every so many layers the dead cells are tried again (assumed)


def dead_evidence(before: FloatMap, own: FloatMap, grown: FloatMap, variance: FloatMap, part_cells: int) -> FloatMap:
    """(nx, ny) logarithm of how much likelier nothing comes than a weak droplet [1]; from DEAD_EVIDENCE on a cell is
    dead (Wald 1945; Page 1954: never below 0).

    before: the same after the last layer; own: what the cell's droplet was to leave on it [m], 0 where there was none
    or nobody saw it: such a layer says nothing, nor does one in which most of the part got nothing; grown: what the
    neighbours' droplets do not explain of its growth [m], with its variance [m^2]; part_cells: number of cells of the
    part.
    """
    weak = WEAK * own
    said = np.divide(weak * (0.5 * weak - grown), variance, out=np.zeros(own.shape), where=own > 0.0)
    if np.count_nonzero(said > 0.0) > WHOLE_HEAD * part_cells:
        return before
    summed = before + np.clip(said, -LAYER_EVIDENCE, LAYER_EVIDENCE)
    return np.asarray(np.clip(summed, 0.0, DEAD_EVIDENCE), np.float64)


def is_probe(layer: int) -> bool:
    """Whether dead cells are tried again in layer number `layer`: a nozzle may have been cleaned."""
    return layer % PROBE_LAYERS == 0
