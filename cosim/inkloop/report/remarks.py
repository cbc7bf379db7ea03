"""Remarks on a run, one sentence each: uncorrected errors, reasons for distrust, disagreement of model and scans."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from inkloop.contract import LAYER_UNKNOWN, STOP_REASON
from inkloop.results import result as results
from inkloop.results.attributes import LEFT_OUT
from inkloop.results.result import Result
from inkloop.units import UM_PER_M

STOP_TITLE = "stopped: the scans do not show what was printed"
COUNTS = {
    "untrusted_cells": "untrusted cells: {}, unseen for too long, their heights are predictions",
    "dead_cells": "dead cells: {}, droplets commanded there bring nothing",
}
SCAN = ("shift_x", "shift_y", "shift_std", "spot_radius")
_UNTRUSTED = "untrusted_reasons"
_REASONS: Mapping[int, tuple[str, str]] = {
    2: (
        "blind_share",
        "{blind_share:.0%} of the part's cells were not measured in the scan of layer {scan}{others}, after more than "
        "five such layers, and the print lived on predictions; check the field of view and the drop-outs of the "
        "profiler",
    ),
    4: (
        "",
        "the first scan shows ground that the scenario calls flat at {ground_offset:.1f} µm in the middle, rising by "
        "{ground_rise_x:.1f} µm along x and {ground_rise_y:.1f} µm along y over the grid; scans were corrected for it: "
        "check the datum and the level of the profiler, or describe the ground in [substrate]",
    ),
    8: (
        "scan_surprise",
        "scans differed from predictions by {scan_surprise:.1f} times what droplets and sensor explain, most in the "
        "scan of layer {scan}{others}; identify the ink of this printer with `inkloop identify`, and check the "
        "profiler",
    ),
    16: (
        "ink_excess",
        "capped cells: {most_capped}, given no more ink, since by the least volume that is believed of their droplets "
        "they stand a layer above their target; by its droplets cell ({ink_excess_i:.0f}, {ink_excess_j:.0f}) is "
        "{ink_excess:.1f} µm higher than by the scan of layer {scan}; check the nozzles there, and register the "
        "profiler with the printer",
    ),
    32: (
        "height_excess",
        "cell ({height_excess_i:.0f}, {height_excess_j:.0f}) stood {height_excess:.1f} µm above its target and what "
        "its droplets explain in the scan of layer {scan}{others}; identify the ink of this printer with `inkloop "
        "identify`, and check the profiler",
    ),
}
"""Number of a reason -> the figure whose worst layer is reported, "" for the last layer, and the sentence.

Untrusted cells, 1, are reported by their number in the last layer.
"""
_STOPS: Mapping[int, str] = {
    64: "nothing grew where droplets were jetted, up to the scan of layer {stop_layer:.0f}: it fits {stop_figure:.1f} "
    "times better to a surface that did not grow. Either the head jets nothing (ink, voltage, nozzles, enable), or the "
    "profiler does not measure (frozen, covered, another file); look at both",
    128: "the profiler shows the scan of an earlier layer again, the same to the last bit, as that of layer "
    "{stop_layer:.0f}; restart the profiler, and check what writes its scans or files",
    256: "scans lag by a layer, up to that of layer {stop_layer:.0f}: it fits {stop_figure:.1f} times better to the "
    "surface of the layer before. Let the profiler begin its scan when the layer is complete, and check that scans are "
    "numbered from 0, the surface before the print",
    512: "scans are {how} against the patterns, up to that of layer {stop_layer:.0f}: it fits {stop_figure:.1f} times "
    "better to what was printed, once so turned. {remedy}",
    1024: "droplets bring {stop_figure:.2f} of the nominal volume by the scan of layer {stop_layer:.0f}, outside of "
    "what is believed, {believed}. Correct h1, h2 and h3 in [ink], by `inkloop identify` for example, check the height "
    "gain of the profiler against a step of known height, or widen the range",
}
"""Number of a reason that stops a print -> the sentence of the layer of that scan."""
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


def remarks(result: Result) -> list[str]:
    """Remarks on errors that the controller could not correct in its last layer, and on disagreement of a shadow's
    model with the scans.

    A sentence each; none where all is well.
    """
    run = result.dataset
    counts = [(text, run[name]) for name, text in COUNTS.items() if name in run]
    found = [text.format(cells[-1].item()) for text, cells in counts if cells.dims == ("layer",) and cells[-1] > 0]
    return [
        *_stops(result),
        *found,
        *untrusted_remarks(run),
        *_left_out(run),
        *_corrected_scans(run),
        *_nothing_printed(result),
        *_unknown_layers(run),
        *_alarms(run),
    ]


def untrusted_remarks(run: xr.Dataset) -> list[str]:
    """One sentence for each reason in `untrusted_reasons` of any layer; none if all is well."""
    reasons = _codes(run, _UNTRUSTED)
    layers = {bit: np.flatnonzero(reasons & bit) for bit in (*_REASONS, *_STOPS)}
    return [
        *(_untrusted(run, bit, layers[bit]) for bit in _REASONS if layers[bit].size),
        *(f"continued all the same: {_stop(run, bit, int(layers[bit][-1]))}" for bit in _STOPS if layers[bit].size),
    ]


def stop_remarks(run: xr.Dataset) -> list[str]:
    """One sentence for each layer whose scan stopped the print; the last one is of the end of a stopped run."""
    reasons = _codes(run, STOP_REASON)
    stops = [(int(reasons[layer]), int(layer)) for layer in np.flatnonzero(reasons)]
    return [_stop(run, reason, layer) for reason, layer in stops if reason in _STOPS]


def ending(result: Result) -> str:
    """The reason why a print was stopped, in one sentence; empty if it was not."""
    if result.stop_reason != results.STOPPED:
        return ""
    return next(reversed(stop_remarks(result.dataset)), "the controller gives no reason")


def _codes(run: xr.Dataset, name: str) -> NDArray[np.int64]:
    """Whole numbers by layer, none where a run has no such variable."""
    has_layers = name in run and run[name].dims == ("layer",)
    return np.nan_to_num(run[name].values).astype(np.int64) if has_layers else np.zeros(0, np.int64)


def _figures(run: xr.Dataset, layer: int) -> dict[str, Any]:
    """Figures of a layer by name, lengths of ground and excess in um."""
    found = {str(name): float(run[name][layer]) for name in run if run[name].dims == ("layer",)}
    lengths = [name for name in found if name.startswith("ground_") or name.endswith("_excess")]
    return found | {name: found[name] * UM_PER_M for name in lengths}


def _untrusted(run: xr.Dataset, reason: int, layers: NDArray[np.int64]) -> str:
    """The sentence of a reason, of the worst of its layers; values are those of the scan before."""
    name, text = _REASONS[reason]
    worst = int(layers[int(np.argmax(run[name].values[layers])) if name else -1])
    others = "" if layers.size == 1 else f" ({layers.size} layers in all, from layer {layers[0] - 1} on)"
    most_capped = int(run["capped_cells"].values[layers].max()) if "capped_cells" in run else 0
    return text.format(**_figures(run, worst), scan=worst - 1, others=others, most_capped=most_capped)


def _stop(run: xr.Dataset, reason: int, layer: int) -> str:
    figures = _figures(run, layer)
    how, remedy = _TURNS.get(int(figures.get("stop_transform", 0)), ("", ""))
    return _STOPS[reason].format(**figures, how=how, remedy=remedy, believed=_believed(run))


def _believed(run: xr.Dataset) -> str:
    """Credible range of volumes of the scenario's controller."""
    components = tomllib.loads(str(run.attrs.get("scenario", ""))).get("components", {})
    options: Mapping[str, float] = next((each for each in components.values() if each.keys() & _VOLUMES.keys()), {})
    least, most = (float(options.get(name, default)) for name, default in _VOLUMES.items())
    return f"{least:g} to {most:g} (volume_least, volume_most)"


def _stops(result: Result) -> list[str]:
    """One sentence on the end of a stopped print, and one for each time that a person has resumed it."""
    found, end = stop_remarks(result.dataset), ending(result)
    earlier = found[:-1] if end else found
    return [f"{STOP_TITLE}: {end}"] * bool(end) + [f"was stopped and resumed: {each}" for each in earlier]


def _left_out(run: xr.Dataset) -> list[str]:
    """One sentence if a time limit made plans skip stages, with the layers of each stage."""
    sums = _codes(run, "left_out")
    layers = {stage: np.count_nonzero(sums & (1 << bit)) for bit, stage in enumerate(LEFT_OUT)}
    stages = [f"{stage.replace('_', ' ')} {count}" for stage, count in layers.items() if count]
    if not stages:
        return []
    return [
        f"the time limit left out or cut short, in how many of {np.count_nonzero(sums)} layers: {', '.join(stages)}; "
        "allow more time, or a smaller horizon"
    ]


def _corrected_scans(run: xr.Dataset) -> list[str]:
    """One sentence if the controller found that the scans are displaced."""
    if "scan_corrected" not in run or not run.scan_corrected[-1]:
        return []
    x, y, std, spot = (float(run[f"scan_{name}"][-1]) * UM_PER_M for name in SCAN)
    wide = f", and the spot is {spot:.0f} µm wide (standard deviation)" if spot > 0.0 else ""
    return [
        f"scans were corrected: the last one was shifted by {x:.1f} µm along x and {y:.1f} µm along y "
        f"(+- {std:.1f} µm){wide}; register the profiler with the printer"
    ]


def _nothing_printed(result: Result) -> list[str]:
    """One sentence if the controller was done before the first layer."""
    if result.stop_reason != "done" or result.dataset.sizes["layer"] > 1:
        return []
    return [
        "nothing was printed: no layer would improve what the first scan shows. The part may be less than a layer "
        "high; or an earlier one lies there: clear the machine, or restart `inkloop bench emulate`"
    ]


def _unknown_layers(run: xr.Dataset) -> list[str]:
    """One sentence on the layers that were aborted."""
    if LAYER_UNKNOWN not in run or not run.layer_unknown.any():
        return []
    layers = [str(layer) for layer in np.flatnonzero(run.layer_unknown.values)]
    which = f"layer {layers[0]} was" if len(layers) == 1 else f"layers {', '.join(layers)} were"
    return [f"{which} aborted, and what of it was jetted is unknown; the next one was planned from the scan"]


def _alarms(run: xr.Dataset) -> list[str]:
    """One sentence on the layers in which the shadow's status was untrusted or a fault."""
    if "shadow_status" not in run:
        return []
    growth = run.growth_divergence.values
    layers = np.flatnonzero(run.shadow_status.values > 0)
    unseen = [f"layer {layer} could not be compared with the model" for layer in layers if np.isnan(growth[layer])]
    strayed = [layer for layer in layers if not np.isnan(growth[layer])]
    if not strayed:
        return unseen[:1]
    worst = max(strayed, key=lambda layer: float(growth[layer]))
    others = f"; {len(strayed)} layers in all, the first is layer {strayed[0]}" if len(strayed) > 1 else ""
    remark = f"layer {worst} grew differently from the shadow's model, by {growth[worst] * UM_PER_M:.2f} µm rms"
    return [f"{remark}{others}", *unseen[:1]]
