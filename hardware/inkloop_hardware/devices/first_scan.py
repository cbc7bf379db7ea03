"""Checks of the first scan of a print on devices: whether the profiler sees the bed, and whether the bed is empty."""

from __future__ import annotations

import numpy as np

from inkloop.component import BoolMap, FloatMap, Job
from inkloop.units import UM_PER_M
from inkloop_hardware.errors import HardwareError
from inkloop_hardware.link.rig import Rig

HIGH_LAYERS = 3.0
"""Height above the plane of the bed from which on a cell carries something: more is no levelling (assumed)."""
HIGH_SHARE = 0.02
"""Share of cells that high from which on a part lies there: fewer are spikes of the sensor (assumed)."""
LOW = 0.05
"""Share of cells that are bed at least, and more than spikes (assumed)."""


class FirstScanError(HardwareError):
    """The first scan does not show an empty bed."""


def check_seen(valid: BoolMap, rig: Rig, what: str) -> None:
    """Raise FirstScanError if a scan has fewer valid cells than `rig.valid_share`; what: names it."""
    share = float(valid.mean())
    if share < rig.valid_share:
        raise FirstScanError(
            f"{what}: {share:.0%} of its cells are valid; needs {rig.valid_share:.0%} (bench.valid_share): is the "
            "profiler covered, off, out of its range, or not over the bed?"
        )


def check_first_scan(height: FloatMap, valid: BoolMap, job: Job, rig: Rig) -> None:
    """Raise FirstScanError if the profiler hardly sees the bed, or if a part lies on a bed that is to be empty.

    height, valid: (nx, ny) [m], of the first scan of a print. A job with a start surface of its own needs no empty bed,
    nor does one with `rig.on_part`.
    """
    check_seen(valid, rig, "the first scan")
    if rig.on_part or job.height_start is not None or not valid.any():
        return
    above = _above_bed(height, valid)
    layer = max(ink.layer_height for ink in job.inks)
    high = int(np.count_nonzero(above > HIGH_LAYERS * layer))
    if high > HIGH_SHARE * above.size:
        raise FirstScanError(
            f"the first scan shows something on the bed: {high} of {above.size} cells stand more than "
            f"{HIGH_LAYERS * layer * UM_PER_M:.0f} µm above it, the highest {above.max() * UM_PER_M:.0f} µm. Take it "
            "off; or print on it with `inkloop run SCENARIO --on-part`"
        )


def _above_bed(height: FloatMap, valid: BoolMap) -> FloatMap:
    """Heights of the valid cells above the bed [m]: a plane with the median slope of cells an eighth of the grid apart,
    below all but the lowest cells."""
    seen = np.where(valid, height, np.nan)
    rest = seen.copy()
    for axis, count in enumerate(height.shape):
        apart = max(1, count // 8)
        if count > apart:
            rises = np.take(seen, range(apart, count), axis) - np.take(seen, range(count - apart), axis)
            slope = np.nanmedian(rises) / apart if np.isfinite(rises).any() else 0.0
            rest -= slope * np.indices(height.shape)[axis]
    found: FloatMap = rest[valid]
    return found - np.quantile(found, LOW)
