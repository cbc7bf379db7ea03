"""Remarks on a run: uncorrected errors, and disagreement of model and scans, one sentence each."""

from __future__ import annotations

import numpy as np
import xarray as xr

from inkloop.contract import LAYER_UNKNOWN
from inkloop.report.trust import STOPPED, stop_remarks, untrusted_remarks
from inkloop.results import result as results
from inkloop.results.attributes import LEFT_OUT
from inkloop.results.result import Result
from inkloop.units import UM_PER_M

REMARKS = {
    "untrusted_cells": "untrusted cells: {}, unseen for too long, their heights are predictions",
    "dead_cells": "dead cells: {}, droplets commanded there bring nothing",
}
SCAN = ("shift_x", "shift_y", "shift_std", "spot_radius")


def remarks(result: Result) -> list[str]:
    """Remarks on errors that the controller could not correct in its last layer, and on disagreement of a shadow's
    model with the scans.

    A sentence each; none where all is well.
    """
    counts = [(text, result.dataset[name]) for name, text in REMARKS.items() if name in result.dataset]
    found = [text.format(cells[-1].item()) for text, cells in counts if cells.dims == ("layer",) and cells[-1] > 0]
    run = result.dataset
    found += untrusted_remarks(run)
    return (
        _stops(result)
        + found
        + _left_out(run)
        + _corrected_scans(run)
        + _nothing_printed(result)
        + _unknown_layers(run)
        + _alarms(run)
    )


def ending(result: Result) -> str:
    """The reason why a print was stopped, in one sentence; empty if it was not."""
    if result.stop_reason != results.STOPPED:
        return ""
    return next(reversed(stop_remarks(result.dataset)), "the controller gives no reason")


def _stops(result: Result) -> list[str]:
    """One sentence on the end of a stopped print, and one for each time that a person has resumed it."""
    found, end = stop_remarks(result.dataset), ending(result)
    earlier = found[:-1] if end else found
    return [f"{STOPPED}: {end}"] * bool(end) + [f"was stopped and resumed: {each}" for each in earlier]


def _left_out(run: xr.Dataset) -> list[str]:
    """One sentence if a time limit made plans skip stages, with the layers of each stage."""
    if "left_out" not in run or run.left_out.dims != ("layer",):
        return []
    sums = np.nan_to_num(run.left_out.values).astype(np.int64)
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
        "nothing was printed: no layer would improve what the first scan shows. Where it shows an earlier part, "
        "clear the machine, or restart `inkloop bench emulate`"
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
