"""Random deviation of droplet volumes from the nominal one, common to all deposition models."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass

import numpy as np

from inkloop.component import FloatMap
from inkloop_lab.models.grid_arrays import reals
from inkloop_lab.models.library import VariationStruct, library


@dataclass(frozen=True)
class DropletVolumes:
    """Factors 1 - U[0, variation] and 1 - U[0, nozzle_variation] by counter-based random numbers (Philox 4x32-10).

    kind: scope of one factor: 1 a droplet, 2 a cell for the whole print, 3 a layer, 4 cell and layer; cell (i, j) is
    jetted by nozzle j modulo nozzle_pitch. The same seed draws the same in every model and FMU. Raises ValueError.
    """

    variation: float = 0.0
    kind: int = 1
    nozzle_variation: float = 0.0
    nozzle_pitch: int = 1
    seed: int = 0

    def __post_init__(self) -> None:
        in_range = all(0.0 <= amplitude <= 1.0 for amplitude in (self.variation, self.nozzle_variation))
        if not in_range or self.kind not in (1, 2, 3, 4) or self.nozzle_pitch < 1:
            raise ValueError(
                f"variation is {self.variation}, nozzle_variation {self.nozzle_variation}, kind {self.kind}, "
                f"nozzle_pitch {self.nozzle_pitch}; needs amplitudes of 0 to 1, a kind of 1 to 4, a nozzle at least"
            )

    def of_layer(self, nx: int, ny: int, number: int) -> FloatMap:
        """(nx, ny): volume of each cell's droplet in layer `number` (counted from 1) [nominal drops]."""
        found = np.empty((nx, ny))
        how = VariationStruct(self.variation, self.kind, self.nozzle_variation, self.nozzle_pitch, self.seed)
        library().inkloop_droplet_volumes(nx, ny, ctypes.byref(how), number, reals(found))
        return found
