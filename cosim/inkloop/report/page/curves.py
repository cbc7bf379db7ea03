"""Curves of several runs as figures of plotly.py: errors and droplets by layer, distribution of final errors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import plotly.graph_objects as go
import xarray as xr
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from inkloop.contract import PATTERN
from inkloop.report.page.charts import SIGN, plain
from inkloop.results.metrics import error_of
from inkloop.units import UM_PER_M

COLOURS = ("#0b5fa5", "#c8541b", "#3a7d44", "#7b4b94", "#8a6d1f")
DASHES = ("solid", "8px,3px", "2px,2px", "8px,3px,2px,3px", "12px,4px")
"""Each run has a colour and a dash of its own, so that lines differ in grey print too."""
BINS = 60
TAIL = 0.005
"""Share of the cells beyond each end of the histogram at most."""
FAR = 20.0
"""Runs whose errors spread this much wider than those of the narrowest are not in the histogram."""
FEW = 12  # layers that get a tick each: Plotly puts ticks between fewer
HEADINGS = (
    "distance of the mean from the target [µm]",
    "standard deviation over the part [µm]",
    "droplets of the layer",
)


def by_layer(runs: Mapping[str, xr.Dataset]) -> go.Figure:
    """Distance of the mean height from the target, unevenness, and droplets, on one axis of layers."""
    figure = make_subplots(rows=3, shared_xaxes=True, vertical_spacing=0.08, subplot_titles=HEADINGS)
    for number, (name, run) in enumerate(runs.items()):
        curves = [np.abs(run["mean_error"].values) * UM_PER_M, run["std"].values * UM_PER_M]
        if PATTERN in run:
            curves.append(np.array([np.count_nonzero(pattern.values) for pattern in run[PATTERN]]))
        for row, curve in enumerate(curves, 1):
            first, line = int(row > 1), _line(number) | ({"shape": "hvh"} if row == 3 else {})
            shown = {"name": plain(name), "legendgroup": name, "showlegend": row == 1, "line": line}
            figure.add_scatter(x=run.layer.values[first:], y=curve[first:], row=row, col=1, **shown)
    for row, name in enumerate(("mean_error", "std"), 1):
        if any((run[name].values[1:] != 0.0).any() for run in runs.values()):  # a logarithm needs a number
            figure.update_yaxes(type="log", tickformat="~g", nticks=3, row=row)
    if max(run.sizes["layer"] for run in runs.values()) <= FEW:
        figure.update_xaxes(dtick=1)
    figure.update_yaxes(rangemode="tozero", row=3)
    figure.update_xaxes(title_text="layer", row=3)
    figure.update_annotations(x=0.0, xanchor="left", font_size=12)
    return figure.update_layout(margin={"l": 50, "r": 10, "t": 64, "b": 44}, legend_y=1.06)


def distribution(errors: Mapping[str, NDArray[np.float64]]) -> go.Figure:
    """Share of the part's cells by final error [um]; the runs are drawn over one another."""
    widths = {name: float(np.quantile(np.abs(error), 0.99)) for name, error in errors.items() if error.size}
    narrow = min((width for width in widths.values() if width > 0.0), default=1.0)
    shown = {name: errors[name] for name, width in widths.items() if width <= FAR * narrow}
    ends = [np.quantile(error, (TAIL, 1.0 - TAIL)) for error in shown.values()] or [np.zeros(2)]
    low, high = float(np.min(ends)), float(np.max(ends))
    margin = 0.1 * (high - low) or 1.0
    edges = np.linspace(low - margin, high + margin, BINS + 1)
    figure = go.Figure()
    for number, name in enumerate(errors):
        if name in shown:
            share = np.histogram(shown[name], edges)[0] / shown[name].size * 100.0
            line = {**_line(number), "shape": "hvh"}
            fill = "none" if number else "tozeroy"
            figure.add_scatter(x=(edges[1:] + edges[:-1]) / 2.0, y=share, name=plain(name), line=line, fill=fill)
    hidden = [f"{plain(name)}: {np.mean(errors[name]):+.0f} µm" for name in widths if name not in shown]
    outside = f"<br>outside: {', '.join(hidden)}" if hidden else ""
    figure.update_xaxes(title_text=SIGN + outside)
    figure.update_yaxes(title_text="cells of the part [%]", rangemode="tozero")
    return figure.update_layout(showlegend=True, margin={"l": 58, "r": 10, "t": 60, "b": 84})


def final_error(run: xr.Dataset) -> NDArray[np.float64]:
    """Target minus final height of the cells of the part [um], where it is known."""
    error = error_of(run)
    return error[np.isfinite(error)]


def _line(number: int) -> dict[str, Any]:
    place = number % len(COLOURS)
    return {"color": COLOURS[place], "dash": DASHES[place], "width": 1.7 if number else 2.4}
