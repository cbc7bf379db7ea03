"""Volume of a part above its substrate, and of a droplet.

    printed = sum over the part of (height - substrate) dx dy
    target  = sum over the part of (target - substrate) dx dy      error = target - printed (positive: too little)
    droplet = sum over the whole map of (height - substrate) dx dy / droplets

A cell without a height would make a volume too small, and its heights are not invented: then there is no volume.
"""

from __future__ import annotations

import numpy as np

from inkloop.component import BoolMap, FloatMap
from inkloop.metrology.evaluation.surface import Found, Refusal
from inkloop.metrology.height_map import HeightMap


def volume_parameters(
    map_: HeightMap, mask: BoolMap, substrate: FloatMap | Refusal, target: FloatMap | None, droplets: int | None
) -> Found:
    """volume_printed, volume_target, volume_error, droplet_volume [m3], droplets [1].

    substrate: (m, n) height below the part [m].
    """
    cell = map_.dx * map_.dy

    def volume(top: FloatMap | None, cells: BoolMap) -> float | Refusal:
        if isinstance(substrate, Refusal):
            return substrate
        if top is None:
            return Refusal("a map knows no target; evaluate a run")
        thickness = (top - substrate)[cells]
        if lacking := int(np.isnan(thickness).sum()):
            return Refusal(f"{lacking} cells have no height: what stands on them is unknown")
        return float(thickness.sum()) * cell

    printed, wanted = volume(map_.z, mask), volume(target, mask)
    whole = volume(map_.z, np.ones_like(mask))
    counted = Refusal("a map knows no droplets; evaluate a run") if droplets is None else float(droplets)
    error = wanted - printed if isinstance(wanted, float) and isinstance(printed, float) else _reason(wanted, printed)
    each: float | Refusal = Refusal("no droplet landed")
    if isinstance(whole, Refusal) or isinstance(counted, Refusal):
        each = _reason(whole, counted)
    elif counted > 0.0:
        each = whole / counted
    return {
        "volume_printed": printed,
        "volume_target": wanted,
        "volume_error": error,
        "droplets": counted,
        "droplet_volume": each,
    }


def _reason(*values: float | Refusal) -> Refusal:
    return next(value for value in values if isinstance(value, Refusal))
