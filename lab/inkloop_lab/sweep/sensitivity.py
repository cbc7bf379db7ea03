"""Sobol' indices: the share of a figure's variance that a key explains alone, and with all its interactions.

First order by Saltelli et al. 2010 (Computer Physics Communications 181, 259-270, Table 2 b), total by Jansen 1999;
intervals by the bootstrap over the points of Saltelli. `scipy.stats.sobol_indices` has the same estimators, but takes
neither one key nor a block that lacks a failed print, and draws other intervals at each call.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from inkloop.results.attributes import Meaning, variable
from inkloop_lab.sweep.dataset import SAMPLE, SEED
from inkloop_lab.sweep.figures import METRICS
from inkloop_lab.sweep.sampling import LEAST

if TYPE_CHECKING:
    import xarray as xr

RESAMPLES = 1000
LEVEL = 0.95
"""Of the intervals."""
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Indices:
    """Indices of one figure, one for each key; `low` and `high` of each, and its bootstrap standard error.

    Rows: first order, total. points: of a block, those whose prints all ended.
    """

    values: Array
    low: Array
    high: Array
    error: Array
    points: int


def indices(a: Array, b: Array, ab: Array, seed: int = 0) -> Indices:
    """Indices from the figures at the points A and B (points), and AB (keys x points); NaN of a print that failed."""
    whole = np.isfinite(a) & np.isfinite(b) & np.isfinite(ab).all(axis=0)
    a, b, ab = a[whole], b[whole], ab[:, whole]
    points = len(a)
    if points < LEAST or np.ptp(np.concatenate([a, b])) == 0.0:  # no variance to explain
        none = np.full((2, len(ab)), np.nan)
        return Indices(none, none, none, none, points)
    rng = np.random.default_rng(seed)
    drawn = np.stack([_estimates(a[i], b[i], ab[:, i]) for i in rng.integers(0, points, (RESAMPLES, points))])
    low, high = np.nanquantile(drawn, [(1 - LEVEL) / 2, (1 + LEVEL) / 2], axis=0)
    return Indices(_estimates(a, b, ab), low, high, np.nanstd(drawn, axis=0, ddof=1), points)


def _estimates(a: Array, b: Array, ab: Array) -> Array:
    """First order and total, keys each."""
    both = np.concatenate([a, b])
    variance = both.var()
    centred_b = b - both.mean()
    first = (centred_b * (ab - a)).mean(axis=1)
    total = 0.5 * np.square(a - ab).mean(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        found: Array = np.stack([first, total]) / variance
    return found


def with_indices(sweep: xr.Dataset, keys: Sequence[str], seed: int = 0) -> xr.Dataset:
    """A sweep over the points of Saltelli with the indices of each metric, from its mean over the seeds.

    Variables first_order and total_order, with _low, _high and _error: other dimensions, metric, key.
    """
    blocks = sweep["block"].values
    metrics = [name for name in METRICS if name in sweep]
    mean = {name: sweep[name].mean(SEED, skipna=False) for name in metrics}
    others = [str(name) for name in sweep["status"].dims if name not in (SAMPLE, SEED)]
    sizes = tuple(sweep.sizes[name] for name in others)
    found = np.full((4, 2, *sizes, len(metrics), len(keys)), np.nan)
    for number, name in enumerate(metrics):
        values = mean[name].transpose(*others, SAMPLE).values
        for place in np.ndindex(sizes):
            own = values[place]
            ab = np.stack([own[blocks == f"AB {key}"] for key in keys])
            each = indices(own[blocks == "A"], own[blocks == "B"], ab, seed)
            for kind, values_of_kind in enumerate((each.values, each.low, each.high, each.error)):
                found[kind, :, *place, number] = values_of_kind
    coordinates = {
        "metric": variable("metric", ("metric",), np.array(metrics, object), "1", Meaning("metric of a print")),
        "key": variable("key", ("key",), np.array(keys, object), "1", Meaning("key of the scenario")),
    }
    variables = {}
    for order, (name, text) in enumerate(ORDERS.items()):
        for kind, (suffix, what) in enumerate(_KINDS.items()):
            meaning = Meaning(f"{what}{text}")
            variables[f"{name}{suffix}"] = variable(
                f"{name}{suffix}", (*others, "metric", "key"), found[kind, order], "1", meaning
            )
    return sweep.assign_coords(coordinates).assign(variables)


ORDERS = {
    "first_order": "share of the variance of a metric that a key explains alone (Sobol')",
    "total_order": "share of the variance of a metric that a key explains with all its interactions (Sobol')",
}
_KINDS = {
    "": "",
    "_low": f"lower end of the {LEVEL:.0%} interval of the ",
    "_high": f"upper end of the {LEVEL:.0%} interval of the ",
    "_error": "bootstrap standard error of the ",
}
