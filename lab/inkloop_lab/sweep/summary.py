"""Findings of a study, as tables for the terminal, a text file and JSON."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from inkloop.report.terminal import NumberTable, number_table
from inkloop.results.metrics import without_sign
from inkloop_lab.sweep.dataset import SEED, STATUSES
from inkloop_lab.sweep.figures import METRICS, heading, label, scaled
from inkloop_lab.sweep.plan import standard_error
from inkloop_lab.sweep.study import Study

if TYPE_CHECKING:
    import xarray as xr

ROWS_MAX = 24
"""Points in the table of the terminal; of more, the best are shown."""
ERRORS_MAX = 5
BESIDES = ("std", "mae", "mean_error", "layers")
"""Metrics of the table besides the one of the study."""


def short_names(keys: Sequence[str]) -> dict[str, str]:
    """Key -> the end of it that tells it from all others."""
    found = {}
    for key in keys:
        parts = key.split(".")
        ends = [".".join(parts[-count:]) for count in range(1, len(parts) + 1)]
        found[key] = next(end for end in ends if sum(f".{other}".endswith(f".{end}") for other in keys) == 1)
    return found


def keys_of(study: Study) -> list[str]:
    """All keys that a study changes."""
    samples = list(study.samples.values) if study.samples else []
    return [*study.axes, *samples, *study.search]


def points(study: Study, sweep: xr.Dataset) -> list[dict[str, Any]]:
    """Every point as plain values: its keys, prints, and mean and standard error of each metric in people's units.

    Of `mean_error` they are those of its absolute values.
    """
    keys, dims = keys_of(study), list(study.shape)
    metrics = [name for name in METRICS if name in sweep]
    arrays = {name: sweep[name].transpose(*dims, SEED).values for name in metrics}
    status = sweep["status"].transpose(*dims, SEED).values
    found = []
    for place in np.ndindex(tuple(study.shape.values())):
        where = dict(zip(dims, place, strict=True))
        setting = {key: _plain(sweep[key].values[where[str(sweep[key].dims[0])]]) for key in keys}
        ended = [STATUSES[code] for code in status[place] if code]
        figures: dict[str, Any] = {}
        for name in metrics:
            known = (scaled(name, float(value)) for value in arrays[name][place] if np.isfinite(value))
            values = without_sign(name, known)
            figures[label(name)] = float(np.mean(values)) if values else None
            figures[f"{label(name)}_standard_error"] = standard_error(values)
        found.append({"keys": setting, "prints": len(ended), "failed": ended.count("failed"), **figures})
    return found


def table_of_points(study: Study, found: Sequence[Mapping[str, Any]], rows_max: int = ROWS_MAX) -> NumberTable:
    """A row for each point, with the mean over its seeds; the best of many."""
    first = study.tables.metric
    metrics = [name for name in dict.fromkeys((first, *BESIDES)) if any(label(name) in each for each in found)]
    shown, caption = list(found), "mean over the seeds, ± its standard error"
    if len(shown) > rows_max:
        known = [each for each in shown if each.get(label(first)) is not None]
        shown = sorted(known, key=lambda each: abs(each[label(first)]))[:rows_max]
        caption += f"; the {len(shown)} points of {len(found)} with the smallest {first}"
    headings = [f"{heading(name)}\n{'[µm]' if METRICS[name][0] == 'm' else ''}" for name in metrics]
    table = number_table("point", *headings, "prints", title=study.title, caption=caption)
    for each in shown:
        figures = [_with_error(each, name, name == first) for name in metrics]
        failed = f" ({each['failed']} failed)" if each["failed"] else ""
        table.add_row(_setting(study, each), *figures, f"{each['prints']}{failed}")
    return table


def winner(study: Study, found: Sequence[Mapping[str, Any]]) -> str:
    """A sentence on the point with the smallest metric, and how many others may be as good; none of a single point.

    A point may be as good where the difference is below twice its standard error. Points with failed prints, which lack
    seeds, do not count.
    """
    own = label(study.tables.metric)
    whole = [each for each in found if each.get(own) is not None and not each["failed"]]
    known = sorted(whole, key=lambda each: abs(each[own]))
    if len(known) < 2:
        return ""
    best, *others = known
    errors = [np.hypot(best[f"{own}_standard_error"], each[f"{own}_standard_error"]) for each in others]
    alike = sum(abs(each[own]) - abs(best[own]) < 2.0 * error for each, error in zip(others, errors, strict=True))
    unit = " µm" if METRICS[study.tables.metric][0] == "m" else ""
    figure = f"{_with_error(best, study.tables.metric, True)}{unit}"
    doubt = f"; {alike} of {len(others)} others are not worse beyond the scatter of the seeds" if alike else ""
    return f"smallest {heading(study.tables.metric)}: {_setting(study, best)}: {figure}{doubt}"


def _setting(study: Study, point: Mapping[str, Any]) -> str:
    names = short_names(keys_of(study))
    return ", ".join(f"{names[key]} {text_of(value)}" for key, value in point["keys"].items()) or "as it stands"


def table_of_indices(study: Study, sweep: xr.Dataset) -> NumberTable:
    """A row for each key: what share of the variance of the study's metric it explains."""
    metric, keys = study.tables.metric, [str(key) for key in sweep["key"].values]
    of_metric = sweep.sel(metric=metric)
    names = short_names(keys)
    others = [str(name) for name in of_metric["first_order"].dims if name != "key"]
    headings = ("alone", "interval", "with interactions", "interval")
    caption = f"share of the variance of {metric} (Sobol' indices), with 95 % intervals"
    table = number_table(
        "key", *(heading.replace(" ", "\n") for heading in headings), title=study.title, caption=caption
    )
    for place in np.ndindex(tuple(of_metric.sizes[name] for name in others)):
        where = dict(zip(others, place, strict=True))
        own = of_metric.isel(where)
        prefix = "".join(f"{name.rpartition('.')[2]} {own[name].item()}: " for name in others)
        for number, key in enumerate(keys):
            figures = []
            for order in ("first_order", "total_order"):
                value, low, high = (float(own[f"{order}{end}"].values[number]) for end in ("", "_low", "_high"))
                figures += [f"{value:.2f}", f"{low:.2f} to {high:.2f}"]
            table.add_row(f"{prefix}{names[key]}", *figures)
    return table


def errors_of(sweep: xr.Dataset) -> list[tuple[str, int]]:
    """Error texts of failed prints, the most frequent first, with how many prints have each."""
    return Counter(str(text) for text in sweep["error"].values.ravel() if text).most_common()


def _with_error(point: Mapping[str, Any], metric: str, with_error: bool) -> str:
    value, error = point[label(metric)], point[f"{label(metric)}_standard_error"]
    if value is None:
        return "-"
    digits = 2 if METRICS[metric][0] == "m" else 1
    return f"{value:.{digits}f} ± {error:.{digits}f}" if with_error and np.isfinite(error) else f"{value:.{digits}f}"


def text_of(value: Any) -> str:
    """A value of a key as a table shows it."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value
