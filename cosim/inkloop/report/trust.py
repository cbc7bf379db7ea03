"""Reasons why a controller did not trust its loop: the observation, its place, and what to do."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from typing import TypeAlias

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from inkloop.contract import STOP_REASON
from inkloop.units import UM_PER_M

STOPPED = "stopped: the scans do not show what was printed"
_REASONS = "untrusted_reasons"


def untrusted_remarks(run: xr.Dataset) -> list[str]:
    """One sentence for each reason in `untrusted_reasons` of any layer; none if all is well."""
    if _REASONS not in run or run[_REASONS].dims != ("layer",):
        return []
    reasons = np.nan_to_num(run[_REASONS].values).astype(np.int64)
    found = ((np.flatnonzero(reasons & bit), remark) for bit, remark in _REMARKS.items())
    stops = ((np.flatnonzero(reasons & bit), remark) for bit, remark in _STOPS.items())
    return [
        *(remark(run, layers) for layers, remark in found if layers.size),
        *(f"continued all the same: {remark(run, int(layers[-1]))}" for layers, remark in stops if layers.size),
    ]


def stop_remarks(run: xr.Dataset) -> list[str]:
    """One sentence for each layer whose scan stopped the print; the last one is of the end of a stopped run."""
    if STOP_REASON not in run or run[STOP_REASON].dims != ("layer",):
        return []
    reasons = np.nan_to_num(run[STOP_REASON].values).astype(np.int64)
    stops = ((layer, _STOPS.get(int(reasons[layer]))) for layer in np.flatnonzero(reasons))
    return [remark(run, int(layer)) for layer, remark in stops if remark]


def _blind(run: xr.Dataset, layers: NDArray[np.int64]) -> str:
    worst = _worst(run, "blind_share", layers)
    return (
        f"{float(run.blind_share[worst]):.0%} of the part's cells were not measured in the scan of layer {worst - 1}"
        f"{_and_others(layers)}, after more than five such layers, and the print lived on predictions; check the "
        "field of view and the drop-outs of the profiler"
    )


def _ground(run: xr.Dataset, layers: NDArray[np.int64]) -> str:
    last = layers[-1]
    offset, rise_x, rise_y = (float(run[f"ground_{name}"][last]) * UM_PER_M for name in ("offset", "rise_x", "rise_y"))
    return (
        f"the first scan shows ground that the scenario calls flat at {offset:.1f} µm in the middle, rising by "
        f"{rise_x:.1f} µm along x and {rise_y:.1f} µm along y over the grid; scans were corrected for it: check the "
        "datum and the level of the profiler, or describe the ground in [substrate]"
    )


def _residuals(run: xr.Dataset, layers: NDArray[np.int64]) -> str:
    worst = _worst(run, "scan_surprise", layers)
    return (
        f"scans differed from predictions by {float(run.scan_surprise[worst]):.1f} times what droplets and sensor "
        f"explain, most in the scan of layer {worst - 1}{_and_others(layers)}; identify the ink of this printer with "
        "`inkloop identify`, and check the profiler"
    )


def _ink(run: xr.Dataset, layers: NDArray[np.int64]) -> str:
    worst = _worst(run, "ink_excess", layers)
    i, j = int(run.ink_excess_i[worst]), int(run.ink_excess_j[worst])
    return (
        f"capped cells: {int(run.capped_cells[layers].max())}, given no more ink, since by the least volume that is "
        f"believed of their droplets they stand a layer above their target; by its droplets cell ({i}, {j}) is "
        f"{float(run.ink_excess[worst]) * UM_PER_M:.1f} µm higher than by the scan of layer {worst - 1}; check the "
        "nozzles there, and register the profiler with the printer"
    )


def _high(run: xr.Dataset, layers: NDArray[np.int64]) -> str:
    worst = _worst(run, "height_excess", layers)
    i, j = int(run.height_excess_i[worst]), int(run.height_excess_j[worst])
    return (
        f"cell ({i}, {j}) stood {float(run.height_excess[worst]) * UM_PER_M:.1f} µm above its target and what its "
        f"droplets explain in the scan of layer {worst - 1}{_and_others(layers)}; identify the ink of this printer "
        "with `inkloop identify`, and check the profiler"
    )


def _no_growth(run: xr.Dataset, layer: int) -> str:
    return (
        f"nothing grew where droplets were jetted, up to the scan of layer {_stop_layer(run, layer)}: "
        f"{_better(run, layer)} a surface that did not grow. Either the head jets nothing (ink, voltage, nozzles, "
        "enable), or the profiler does not measure (frozen, covered, another file); look at both"
    )


def _same_scan(run: xr.Dataset, layer: int) -> str:
    return (
        f"the profiler shows the scan of an earlier layer again, the same to the last bit, as that of layer "
        f"{_stop_layer(run, layer)}; restart the profiler, and check what writes its scans or files"
    )


def _late(run: xr.Dataset, layer: int) -> str:
    return (
        f"scans lag by a layer, up to that of layer {_stop_layer(run, layer)}: {_better(run, layer)} the surface of "
        "the layer before. Let the profiler begin its scan when the layer is complete, and check that scans are "
        "numbered from 0, the surface before the print"
    )


def _turned(run: xr.Dataset, layer: int) -> str:
    how, remedy = _TURNS[int(run.stop_transform[layer])]
    return (
        f"scans are {how} against the patterns, up to that of layer {_stop_layer(run, layer)}: {_better(run, layer)} "
        f"what was printed, once so turned. {remedy}"
    )


def _volume(run: xr.Dataset, layer: int) -> str:
    return (
        f"droplets bring {float(run.stop_figure[layer]):.2f} of the nominal volume by the scan of layer "
        f"{_stop_layer(run, layer)}, outside of what is believed, {_believed(run)}. Correct h1, h2 and h3 in [ink], "
        "by `inkloop identify` for example, check the height gain of the profiler against a step of known height, or "
        "widen the range"
    )


def _stop_layer(run: xr.Dataset, layer: int) -> int:
    return int(run.stop_layer[layer])


def _better(run: xr.Dataset, layer: int) -> str:
    return f"it fits {float(run.stop_figure[layer]):.1f} times better to"


def _worst(run: xr.Dataset, name: str, layers: NDArray[np.int64]) -> int:
    """The layer with the largest value; values are those of the scan before."""
    return int(layers[int(np.argmax(run[name].values[layers]))])


def _and_others(layers: NDArray[np.int64]) -> str:
    return "" if layers.size == 1 else f" ({layers.size} layers in all, from layer {layers[0] - 1} on)"


def _believed(run: xr.Dataset) -> str:
    """Credible range of volumes of the scenario's controller."""
    components = tomllib.loads(str(run.attrs.get("scenario", ""))).get("components", {})
    options: Mapping[str, float] = next((each for each in components.values() if each.keys() & _VOLUMES.keys()), {})
    least, most = (float(options.get(name, default)) for name, default in _VOLUMES.items())
    return f"{least:g} to {most:g} (volume_least, volume_most)"


_VOLUMES = {"volume_least": 0.5, "volume_most": 1.25}
"""Defaults of a controller's credible volumes, as in controller/core/observer."""
_AXES = (
    "Exchange the axes: set rows_along to the other axis in a `MapFolder`, fastest to the other axis in the mapping "
    "file of a device, or set transpose in `ports` of an FMU or in the connection"
)
_ROTATION = "to rotation_deg of a `MapFolder` and correct its offsets, or turn the maps in the settings of the profiler"
_MIRROR = (
    'of a `MapFolder` (or "none" if it is set so) and correct {}, in `ports` of an FMU or in the connection, or mirror '
    "the maps in the settings of the profiler"
)
_TURNS: Mapping[int, tuple[str, str]] = {
    2: ("mirrored in x", f'Set mirror = "x" {_MIRROR.format("offset_x_um")}'),
    3: ("mirrored in y", f'Set mirror = "y" {_MIRROR.format("offset_y_um")}'),
    4: ("turned by 180 degrees", f"Add 180 {_ROTATION}"),
    5: ("transposed", _AXES),
    6: ("turned by 90 degrees", f"Add 90 {_ROTATION}"),
    7: ("turned by 270 degrees", f"Add 270 {_ROTATION}"),
    8: ("transposed and turned by 180 degrees", f"{_AXES}; then add 180 {_ROTATION}"),
}
"""Number of the transform from a scan to the printer -> orientation of the scans, and its correction."""
_Remark: TypeAlias = Callable[[xr.Dataset, NDArray[np.int64]], str]
_REMARKS: Mapping[int, _Remark] = {2: _blind, 4: _ground, 8: _residuals, 16: _ink, 32: _high}
"""Number of the reason -> its sentence; untrusted cells, 1, are reported by their number in the last layer."""
_STOPS: Mapping[int, Callable[[xr.Dataset, int], str]] = {
    64: _no_growth, 128: _same_scan, 256: _late, 512: _turned, 1024: _volume,
}  # fmt: skip
"""Number of a reason that stops a print -> the sentence of the layer of that scan."""
