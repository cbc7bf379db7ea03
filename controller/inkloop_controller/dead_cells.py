"""Cells whose droplets do not come, and when they are tried again (controller/core/estimator/dead_cells.h)."""

from __future__ import annotations

DEAD_EVIDENCE = 15.0  # from here on a cell is dead
PROBE_LAYERS = 5  # every so many layers the dead cells are tried again (assumed)


def is_probe(layer: int) -> bool:
    """Whether dead cells are tried again in layer number `layer`: a nozzle may have been cleaned."""
    return layer % PROBE_LAYERS == 0
