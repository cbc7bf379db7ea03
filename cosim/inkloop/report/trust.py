"""Why a controller did not trust its loop: what was seen, where, and what to do."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeAlias

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from inkloop.units import UM_PER_M

_REASONS = "untrusted_reasons"


def untrusted_remarks(run: xr.Dataset) -> list[str]:
    """One sentence for each reason that `untrusted_reasons` had in any layer; none where all is well."""
    if _REASONS not in run or run[_REASONS].dims != ("layer",):
        return []
    reasons = np.nan_to_num(run[_REASONS].values).astype(np.int64)
    found = ((np.flatnonzero(reasons & bit), remark) for bit, remark in _REMARKS.items())
    return [remark(run, layers) for layers, remark in found if layers.size]


def _blind(run: xr.Dataset, layers: NDArray[np.int64]) -> str:
    worst = _worst(run, "blind_share", layers)
    share = float(run.blind_share[worst])
    return (
        f"{share:.0%} of the part's cells were not measured in the scan of layer {worst - 1}"
        f"{_and_others(layers)}; check the field of view and the drop-outs of the profiler"
    )


def _ground(run: xr.Dataset, layers: NDArray[np.int64]) -> str:
    last = layers[-1]
    offset, rise_x, rise_y = (float(run[f"ground_{name}"][last]) * UM_PER_M for name in ("offset", "rise_x", "rise_y"))
    return (
        f"the first scan shows ground that the scenario calls flat at {offset:.1f} µm in the middle, rising by "
        f"{rise_x:.1f} µm along x and {rise_y:.1f} µm along y over the grid; check the datum and the level of the "
        "profiler, or describe the ground in [substrate]"
    )


def _residuals(run: xr.Dataset, layers: NDArray[np.int64]) -> str:
    worst = _worst(run, "scan_surprise", layers)
    return (
        f"scans differed from predictions by {float(run.scan_surprise[worst]):.1f} times what droplets and sensor "
        f"explain, most in the scan of layer {worst - 1}{_and_others(layers)}; identify the ink of this printer, and "
        "check the profiler"
    )


def _ink(run: xr.Dataset, layers: NDArray[np.int64]) -> str:
    worst = _worst(run, "ink_excess", layers)
    i, j = int(run.ink_excess_i[worst]), int(run.ink_excess_j[worst])
    return (
        f"capped cells: {int(run.capped_cells[layers].max())}, given no more ink than an open loop would jet there; by "
        f"its droplets cell ({i}, {j}) is {float(run.ink_excess[worst]) * UM_PER_M:.1f} µm higher than by the scan of "
        f"layer {worst - 1}; register the profiler with the printer, and check the nozzles there"
    )


def _high(run: xr.Dataset, layers: NDArray[np.int64]) -> str:
    worst = _worst(run, "height_excess", layers)
    i, j = int(run.height_excess_i[worst]), int(run.height_excess_j[worst])
    return (
        f"cell ({i}, {j}) stood {float(run.height_excess[worst]) * UM_PER_M:.1f} µm above its target and what its "
        f"droplets explain in the scan of layer {worst - 1}{_and_others(layers)}; identify the ink of this printer, "
        "and check the profiler"
    )


def _worst(run: xr.Dataset, name: str, layers: NDArray[np.int64]) -> int:
    """The layer in which it is largest; its values are those of the scan before."""
    return int(layers[int(np.argmax(run[name].values[layers]))])


def _and_others(layers: NDArray[np.int64]) -> str:
    return "" if layers.size == 1 else f" ({layers.size} layers in all, from layer {layers[0] - 1} on)"


_Remark: TypeAlias = Callable[[xr.Dataset, NDArray[np.int64]], str]
_REMARKS: Mapping[int, _Remark] = {2: _blind, 4: _ground, 8: _residuals, 16: _ink, 32: _high}
"""By the number of the reason; untrusted cells, 1, are reported by their number in the last layer."""
