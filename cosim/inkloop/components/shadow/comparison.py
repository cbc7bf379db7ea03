"""Divergence of a model from the scans: of the whole surface and of the growth in the last layers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from inkloop.component import BoolMap, FloatMap


@dataclass(frozen=True)
class Divergence:
    """Root mean squares over the part [m]; NaN where no cell can be compared.

    growth: of the height added since the scan before, over cells seen in both; surface: of the heights, over cells
    seen. Growth distinguishes a device that fails from one that is slightly off in every layer, and needs no datum.
    """

    growth: float = math.nan
    surface: float = math.nan


@dataclass(frozen=True, eq=False)
class ScannedLayer:
    """One layer as measured and as the model has it: (nx, ny) heights [m], `valid` the cells that were measured."""

    measured: FloatMap
    valid: BoolMap
    surface: FloatMap

    def divergence(self, before: ScannedLayer | None, mask: BoolMap) -> Divergence:
        """Against the scan before it (None: there is none), over the cells of `mask` (nx, ny)."""
        error, seen = self.measured - self.surface, self.valid & mask
        if before is None:
            return Divergence(surface=_rms(error[seen]))
        both = seen & before.valid
        return Divergence(_rms((error - (before.measured - before.surface))[both]), _rms(error[seen]))


def start_surface(assumed: FloatMap, measured: FloatMap, valid: BoolMap) -> FloatMap:
    """The start surface: the scan of layer 0, and on cells that it did not see `assumed`, raised by its mean
    difference.

    All (nx, ny), heights [m]; `assumed` itself where no cell was seen.
    """
    if not valid.any():
        return assumed
    offset = float(np.median((measured - assumed)[valid]))
    return np.where(valid, measured, assumed + offset)


def _rms(differences: FloatMap) -> float:
    return float(np.sqrt(np.square(differences).mean())) if differences.size else math.nan
