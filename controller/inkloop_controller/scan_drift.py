"""What the sensor's frame did between two scans, told by cells that no droplet reaches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inkloop.component import BoolMap, FloatMap
from inkloop_controller.core import checked, pointer
from inkloop_controller.core_library import DRIFT_MAPS, library
from inkloop_controller.criterion import beside


@dataclass(frozen=True)
class Drift:
    """plane: (nx, ny) to be taken off the scan [m]; residual_variance: of the reference cells about it [m^2], None
    where they are too few to tell.
    """

    plane: FloatMap
    residual_variance: float | None


class ScanDrift:
    """Offset and tilt of a scan against what the unprinted cells are known to be.

    They are the cells out of reach of every droplet: two cells and more from the part. What they were at first may be
    uneven or tilted and stays; only what has changed since is the sensor's. An offset there was in the very first scan
    cannot be told from the substrate. A plane is fitted where the cells surround the part well enough, an offset where
    they do not, and nothing where there are hardly any: a part that fills the grid leaves drift in the heights.
    """

    def __init__(self, part: BoolMap) -> None:
        self.cells = ~(part | beside(part))
        self._part = np.ascontiguousarray(part)

    def seen(self, scan: FloatMap, known: FloatMap, valid: BoolMap) -> Drift:
        """The drift in a scan (nx, ny) [m] of a surface that is `known` [m] at the reference cells."""
        shape = self._part.shape
        given = [checked("scan", scan, "f8", shape), checked("known", known, "f8", shape)]
        plane = np.empty(shape)
        variance = library().inkloop_scan_drift(
            *shape,
            pointer(self._part),
            *(pointer(array) for array in given),
            pointer(checked("valid", valid, "?", shape)),
            pointer(np.empty((DRIFT_MAPS, *shape))),
            pointer(plane),
        )
        return Drift(plane, None if variance < 0.0 else float(variance))
