"""Attributes of the variables of `result.nc` by the CF conventions: what each holds, its unit, codes and limits.

No `standard_name` of the CF table is the height of a printed surface; only `valid` has one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from inkloop.component import Status
from inkloop.contract import DROP_LEVEL, HEIGHT, LAYER_UNKNOWN, MEASURED_HEIGHT, PATTERN, VALID
from inkloop.results.metrics import SIGN

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

__all__ = ["CONVENTIONS", "Meaning", "variable"]

CONVENTIONS = "CF-1.11"
_INKS = ("none", "ink_a", "ink_b")
_STATUS = tuple(status.name.lower() for status in Status)
_PLANS = ("optimal", "repaired", "budget", "time_limit", "interrupted", "fallback", "fixed", "done")
LEFT_OUT = ("relaxation", "starts", "repair", "fewer_layers", "certificate")
_REASONS = (
    *("unseen_cells", "blind_scans", "ground_not_flat", "residuals", "capped_cells", "cells_too_high"),
    *("no_growth", "same_scan", "late_scans", "turned_scans", "volume"),
)
_TRANSFORMS = (
    *("none", "unused", "mirrored_in_x", "mirrored_in_y", "turned_by_180_degrees", "transposed"),
    *("turned_by_90_degrees", "turned_by_270_degrees", "transposed_and_turned_by_180_degrees"),
)
_PART = "(comment: over the cells of the part)"
_SHARE = (0.0, 1.0)
_COUNT = (0.0, None)


@dataclass(frozen=True)
class Meaning:
    """Content of a variable.

    flags: meanings of the codes 0, 1, ...; masks: meanings of the bits 1, 2, 4, ...; limits: smallest and largest valid
    value, None where there is none; others: further attributes.
    """

    long_name: str
    flags: tuple[str, ...] = ()
    masks: tuple[str, ...] = ()
    limits: tuple[float | None, float | None] = (None, None)
    others: Mapping[str, str] | None = None


def _error(long_name: str, method: str) -> Meaning:
    return Meaning(long_name, others={"cell_methods": f"area: {method} {_PART}"})


def _yes(long_name: str) -> Meaning:
    return Meaning(long_name, flags=("no", "yes"))


MEANINGS: Mapping[str, Meaning] = {
    "layer": Meaning("number of the layer; 0 is the start surface"),
    "x": Meaning("position of the centre of a cell along x", others={"axis": "X"}),
    "y": Meaning("position of the centre of a cell along y", others={"axis": "Y"}),
    "time": Meaning("time from the start of the run to the end of the layer"),
    "target_height": Meaning("height that the part shall have at the end of the print"),
    "mask": Meaning("cells of the part", flags=("outside", "part")),
    HEIGHT: Meaning("height of the surface after the layer, above z = 0"),
    "area": Meaning("share of each cell that ink covers after the layer", limits=_SHARE),
    MEASURED_HEIGHT: Meaning(
        "scan of the layer: height that the profiler reports", others={"ancillary_variables": VALID}
    ),
    VALID: Meaning(
        "cells that the scan of the layer measured",
        flags=("not_measured", "measured"),
        others={"standard_name": "quality_flag"},
    ),
    "estimated_height": Meaning("height that the controller takes the surface for, from the scan and its prediction"),
    "shadow_height": Meaning("height by the model that follows the commanded patterns"),
    "shadow_status": Meaning(
        "status of that model: untrusted where a layer grew differently from it or could not be compared, fault where "
        "so much that the run ended",
        flags=_STATUS,
    ),
    PATTERN: Meaning("ink that was commanded on each cell in the layer", flags=_INKS),
    "planned_droplets": Meaning("droplets on the cell in the layers that were planned, this one first", limits=_COUNT),
    DROP_LEVEL: Meaning("drops that each droplet of the layer consists of", limits=_COUNT),
    "ink": Meaning("ink that fills most of what the layer added to each cell", flags=_INKS),
    "interval": Meaning("number of the interval of height, from below"),
    "region_bottom": Meaning("lower end of each interval of height in which ink A is wanted"),
    "region_top": Meaning("upper end of each interval of height in which ink A is wanted"),
    "mismatch": Meaning("volume of ink A that is misplaced or missing, as a share of the volume wanted", limits=_COUNT),
    "modified": _yes("an event was in effect in the layer"),
    LAYER_UNKNOWN: _yes("the layer was aborted, and which droplets of its pattern were jetted is unknown"),
    "mean_error": _error(f"mean error: target minus height ({SIGN})", "mean"),
    "mae": _error("mean absolute error, of target minus height", "mean_absolute_value"),
    "rms": _error("root mean square error, of target minus height", "root_mean_square"),
    "std": _error("standard deviation of the error, of target minus height (population)", "standard_deviation"),
    "growth_divergence": _error("scanned growth of the layer minus growth by the model", "root_mean_square"),
    "surface_divergence": _error("scan of the layer minus surface by the model", "root_mean_square"),
    "droplets_a": Meaning("drops of ink A that landed in all layers so far", limits=_COUNT),
    "droplets_b": Meaning("drops of ink B that landed in all layers so far", limits=_COUNT),
    "height_mean": Meaning(
        "mean height after the layer", others={"cell_methods": "area: mean (comment: over the whole grid)"}
    ),
    "volume_lost": Meaning("volume that left the grid over its open edge in all layers so far"),
    "volume_removed": Meaning("volume that the roller has cut in all layers so far", limits=_COUNT),
    "fallbacks": Meaning("liquid bodies that were solved in the linear form, in all layers so far", limits=_COUNT),
    "objective": Meaning("objective of the plan for the layer: alpha times error, and (1 - alpha) times deviation"),
    "objective_error": Meaning("error in the objective: weighted mean of what lies below and above the target"),
    "objective_deviation": Meaning("deviation in the objective: standard deviation of the surface after the horizon"),
    "bound": Meaning("value that the objective of no plan can fall below; counts where bound_valid is true"),
    "bound_valid": _yes("there is a bound for the objective of the layer"),
    "bound_confidence": Meaning("probability that the bound holds", limits=_SHARE),
    "gap": Meaning("distance of the objective from its bound, as a share of the objective"),
    "plan_status": Meaning("how the plan for the layer came about", flags=_PLANS),
    "solve_time": Meaning("wall-clock time from the scan to the plan", others={"reproducible": "no: wall-clock"}),
    "sweeps": Meaning("sweeps of the search for the plan of the layer", limits=_COUNT),
    "left_out": Meaning("stages of the plan that a time limit has left out or cut short", masks=LEFT_OUT),
    "volume_scale": Meaning("droplet volume that the controller learnt, as a share of the nominal one", limits=_COUNT),
    "untrusted_cells": Meaning("cells of the part that no scan has shown for too many layers", limits=_COUNT),
    "dead_cells": Meaning("cells whose droplets bring nothing, found from the scans", limits=_COUNT),
    "capped_cells": Meaning("cells that get no more ink: by their droplets they are high enough", limits=_COUNT),
    "untrusted_reasons": Meaning("reasons why the controller does not trust its loop", masks=_REASONS),
    "blind_share": Meaning("share of the part's cells that the last scan did not measure", limits=_SHARE),
    "ground_offset": Meaning("height of the middle of ground that is called flat, in the first scan"),
    "ground_rise_x": Meaning("rise over the grid along x of ground that is called flat, in the first scan"),
    "ground_rise_y": Meaning("rise over the grid along y of ground that is called flat, in the first scan"),
    "scan_surprise": Meaning(
        "difference of scans from predictions, in standard deviations of what droplets and sensor explain",
        limits=_COUNT,
    ),
    "ink_excess": Meaning("most that a cell of the part is higher by its droplets than by its scans"),
    "ink_excess_i": Meaning("cell along x of the largest excess of ink"),
    "ink_excess_j": Meaning("cell along y of the largest excess of ink"),
    "height_excess": Meaning("most that a cell of the part stands above its target and what its droplets explain"),
    "height_excess_i": Meaning("cell along x of the largest excess of height"),
    "height_excess_j": Meaning("cell along y of the largest excess of height"),
    "scan_corrected": _yes("scans were read as displaced ones: shift, rotation, magnification and spot explain them"),
    "scan_shift_x": Meaning("shift of the last scan against the printer along x, as found"),
    "scan_shift_y": Meaning("shift of the last scan against the printer along y, as found"),
    "scan_shift_std": Meaning("standard deviation of the error of the shift found", limits=_COUNT),
    "scan_spot_radius": Meaning("standard deviation of the Gaussian spot of the sensor, as found", limits=_COUNT),
    "scan_spot_std": Meaning("standard deviation of the error of the spot radius found", limits=_COUNT),
    "scan_rotation": Meaning("rotation of the scans against the printer, as found, from x to y"),
    "scan_magnification": Meaning("magnification of the scans against the printer, as found"),
    "stop_reason": Meaning("reason for which the scan of the layer stopped the print", masks=_REASONS),
    "stop_layer": Meaning("layer whose scan was the last straw, where scans do not show what was printed"),
    "stop_transform": Meaning("what brings mirrored or turned scans to the printer", flags=_TRANSFORMS),
    "stop_figure": Meaning(
        "how many times better the scan fits another explanation than as it was read; for volume that of the droplets, "
        "as a share of the nominal one",
        limits=_COUNT,
    ),
}
"""Contents of inkloop's own variables, by name."""


def variable(
    name: str, dims: tuple[str, ...], values: ArrayLike, unit: str, meaning: Meaning | None = None, giver: str = ""
) -> xr.Variable:
    """A variable with its attributes; of an unknown name its long name says which component (`giver`) put it out."""
    import xarray as xr

    array = np.asarray(values)
    unknown = Meaning(f"output {name} of the {giver}" if giver else name.replace("_", " "))
    attributes = _attributes(meaning or MEANINGS.get(name, unknown), str(unit), array.dtype)
    return xr.Variable(dims, as_index(array) if dims == (name,) else array, attributes)


def as_index(values: np.ndarray) -> np.ndarray | pd.Index:
    """Numbers along a dimension as xarray keeps them; to make its index of an array, it would import pint if it can."""
    import pandas as pd

    return pd.Index(values) if values.dtype.kind in "iuf" else values


def _attributes(meaning: Meaning, unit: str, dtype: np.dtype[Any]) -> dict[str, Any]:
    """CF asks that codes and limits have the type of the values; a truth value is stored as a byte."""
    stored = np.dtype(np.int8) if dtype.kind == "b" else dtype
    found: dict[str, Any] = {"units": unit, "long_name": meaning.long_name}
    if meaning.flags and stored.kind in "iu":
        found |= {"flag_values": np.arange(len(meaning.flags), dtype=stored), "flag_meanings": " ".join(meaning.flags)}
    if meaning.masks and stored.kind in "iu":
        bits = 1 << np.arange(len(meaning.masks))
        found |= {"flag_masks": bits.astype(stored), "flag_meanings": " ".join(meaning.masks)}
    low, high = meaning.limits
    if low is not None and high is not None:
        found["valid_range"] = np.array([low, high], stored)
    elif low is not None:
        found["valid_min"] = stored.type(low)
    return found | dict(meaning.others or {})
