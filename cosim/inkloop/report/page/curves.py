"""Curves of several runs as figures of Plotly: errors and droplets by layer, and the distribution of final errors."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from inkloop.contract import PATTERN
from inkloop.units import UM_PER_M

Figure = dict[str, Any]
"""`data` and `layout` as `Plotly.react` takes them."""
COLOURS = ("#0b5fa5", "#c8541b", "#3a7d44", "#7b4b94", "#8a6d1f")
DASHES = ("solid", "8px,3px", "2px,2px", "8px,3px,2px,3px", "12px,4px")
"""Each run has a colour and a dash of its own, so that lines differ in grey print too."""
BINS = 60
TAIL = 0.005
"""Share of the cells beyond each end of the histogram at most."""
FAR = 20.0
"""Runs whose errors spread this much wider than those of the narrowest are not in the histogram."""
DECADES = range(-4, 5)
FEW = 12  # layers that get a tick each: Plotly puts ticks between fewer
HEADINGS = (
    "distance of the mean from the target [µm]",
    "standard deviation over the part [µm]",
    "droplets of the layer",
)
_GRID = {"gridcolor": "#e4e4e4", "zeroline": False}


def by_layer(runs: Mapping[str, xr.Dataset]) -> Figure:
    """Distance of the mean height from the target, unevenness, and droplets, on one axis of layers."""
    data: list[dict[str, Any]] = []
    for number, (name, run) in enumerate(runs.items()):
        layer = run.layer.values.tolist()
        common = {"type": "scatter", "mode": "lines", "legendgroup": name, "name": plain(name)}
        line = _line(number)
        mean, std = run["mean_error"].values * UM_PER_M, run["std"].values[1:] * UM_PER_M
        data.append({**common, "line": line, "x": layer, "y": _numbers(np.abs(mean)), "yaxis": "y"})
        data.append({**common, "line": line, "x": layer[1:], "y": _numbers(std), "yaxis": "y2", "showlegend": False})
        if PATTERN in run:
            jetted = [int(np.count_nonzero(pattern.values)) for pattern in run[PATTERN][1:]]
            steps = {**line, "shape": "hvh"}
            data.append({**common, "line": steps, "x": layer[1:], "y": jetted, "yaxis": "y3", "showlegend": False})
    is_printed = any((run["std"].values[1:] > 0.0).any() for run in runs.values())
    mean_axis, std_axis = (_axis(data, name) if is_printed else {} for name in ("y", "y2"))
    whole = {"dtick": 1} if max((run.sizes["layer"] for run in runs.values()), default=0) <= FEW else {}
    layout = {
        "xaxis": {**_GRID, **whole, "title": {"text": "layer"}, "anchor": "y3"},
        "yaxis": {**_GRID, **mean_axis, "domain": [0.72, 1.0]},
        "yaxis2": {**_GRID, **std_axis, "domain": [0.36, 0.64]},
        "yaxis3": {**_GRID, "domain": [0.0, 0.28], "rangemode": "tozero"},
        "annotations": [_heading(text, top) for text, top in zip(HEADINGS, (1.0, 0.64, 0.28), strict=True)],
        "hovermode": "x",
        "legend": {"orientation": "h", "y": 1.06, "yanchor": "bottom", "x": 0.0},
    }
    return {"data": data, "layout": layout}


def distribution(runs: Mapping[str, xr.Dataset]) -> Figure:
    """Share of the part's cells by final error; the runs are drawn over one another."""
    errors = {name: _final_error(run) for name, run in runs.items()}
    errors = {name: error for name, error in errors.items() if error.size}
    widths = {name: float(np.quantile(np.abs(error), 0.99)) for name, error in errors.items()}
    narrow = min((width for width in widths.values() if width > 0.0), default=1.0)
    shown = {name: error for name, error in errors.items() if widths[name] <= FAR * narrow}
    low = min((float(np.quantile(error, TAIL)) for error in shown.values()), default=0.0)
    high = max((float(np.quantile(error, 1.0 - TAIL)) for error in shown.values()), default=0.0)
    margin = 0.1 * (high - low) or 1.0
    edges = np.linspace(low - margin, high + margin, BINS + 1)
    data = []
    for number, name in enumerate(runs):
        if name in shown:
            share = np.histogram(shown[name], edges)[0] / shown[name].size * 100.0
            line = {**_line(number), "shape": "hvh"}
            middles = ((edges[1:] + edges[:-1]) / 2.0).tolist()
            fill = {"fill": "tozeroy"} if number == 0 else {}
            trace = {"type": "scatter", "mode": "lines", "name": plain(name), "line": line, "x": middles}
            data.append({**trace, **fill, "y": share.tolist()})
    hidden = [f"{name}: {np.mean(error):+.0f} µm" for name, error in errors.items() if name not in shown]
    outside = f"<br>outside: {', '.join(map(plain, hidden))}" if hidden else ""
    layout = {
        "xaxis": {**_GRID, "title": {"text": f"target - height [µm]<br>- too high, + too low{outside}"}},
        "yaxis": {**_GRID, "title": {"text": "cells of the part [%]"}, "rangemode": "tozero"},
        "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0.0},
        "showlegend": True,
    }
    return {"data": data, "layout": layout}


def _axis(data: Sequence[Mapping[str, Any]], name: str) -> dict[str, Any]:
    """A logarithmic axis for the lines on it: with decades, or with 1, 2, 5 where there are few."""
    values = [value for trace in data if trace["yaxis"] == name for value in trace["y"] if value is not None]
    digits = (1,) if values and max(values) > 300.0 * min(values) else (1, 2, 5)
    ticks = [digit * 10.0**power for power in DECADES for digit in digits]
    return {"type": "log", "tickvals": ticks, "ticktext": [f"{um:g}" for um in ticks]}


def _line(number: int) -> dict[str, Any]:
    place = number % len(COLOURS)
    return {"color": COLOURS[place], "dash": DASHES[place], "width": 2.4 if number == 0 else 1.7}


def _heading(text: str, top: float) -> dict[str, Any]:
    place = {"x": 0.0, "y": top, "xref": "paper", "yref": "paper", "xanchor": "left", "yanchor": "bottom"}
    return {**place, "text": text, "showarrow": False}


def _final_error(run: xr.Dataset) -> Any:
    error = (run.target_height - run.height[-1]).values[run["mask"].values.astype(bool)] * UM_PER_M
    return error[np.isfinite(error)]


def _numbers(values: Any) -> list[float | None]:
    """With None where a number is not finite; a logarithmic axis shows no zero."""
    return [float(value) if np.isfinite(value) and value > 0.0 else None for value in values]


def plain(text: str) -> str:
    """A text of the user for Plotly, which interprets some markup: all of it is escaped."""
    return html.escape(text, quote=False)
