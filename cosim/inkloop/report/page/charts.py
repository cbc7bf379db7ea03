"""Figures of plotly.py that the page fills with maps: colours, axes and texts of every chart of a layer."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from inkloop.report.page.maps import FINEST
from inkloop.units import MM_PER_M, UM_PER_M

Values = dict[str, Any]
"""`data` and `layout` as `Plotly.react` takes them, without the template, which the page has once."""
Edges = Sequence[Sequence[float]]

ERROR_COLOURS = (
    *("#67001f", "#b2182b", "#d6604d", "#f4a582", "#fddbc7", "#f7f7f7"),
    *("#d1e5f0", "#92c5de", "#4393c3", "#2166ac", "#053061"),
)
HEIGHT_COLOURS = ((0.0, "#ffffff"), (0.5, "#7db0da"), (1.0, "#08306b"))
INK_COLOURS = ("#f3f3f3", "#0b5fa5", "#d9a441")
SIGN = "target - height [µm]<br>- too high, + too low"
PLACE = "x %{x:.2f} mm, y %{y:.2f} mm<br>"
TICKS = 3
"""Numbers on either side of zero at a scale of errors at most."""
_SOLID_WIDTH, _SOLID_HEIGHT = 1.2, 0.5  # of the longer side, and of the heights, in the 3D view
_BAR = {"orientation": "h", "thickness": 10, "lenmode": "pixels", "len": 240, "outlinewidth": 0.5}
_BAR |= {"y": -0.17, "yanchor": "top", "title": {"side": "bottom"}}
_AXIS = {"gridcolor": "#e4e4e4", "zeroline": False, "title": {"standoff": 4}, "hoverformat": ".2f"}
TEMPLATE = go.layout.Template(
    layout={
        "font": {"family": 'system-ui, "Segoe UI", "DejaVu Sans", sans-serif', "size": 12, "color": "#1b1b1b"},
        "title": {"x": 0.02, "y": 0.98, "yanchor": "top", "font": {"size": 14}},
        "legend": {"orientation": "h", "x": 0.0, "y": 1.02, "yanchor": "bottom"},
        "hovermode": "x",
        "xaxis": _AXIS,
        "yaxis": _AXIS,
        "coloraxis": {"colorbar": _BAR},
    },
    data={"scatter": [{"mode": "lines"}], "heatmap": [{"hoverongaps": False}]},
)


@dataclass(frozen=True)
class ErrorScale:
    """One scale for the errors of all runs [um], which grows like a logarithm beyond `width`, up to `limit`."""

    width: float
    limit: float

    @classmethod
    def of(cls, errors: Sequence[NDArray[np.float64]]) -> ErrorScale:
        """Up to the largest errors, and fine enough for the smallest; errors: of the cells of each part."""
        far = [max(1e-3, float(np.quantile(np.abs(error), 0.99))) for error in errors if error.size] or [1.0]
        return cls(max(min(far), max(far) / FINEST) / 2.0, max(far))

    @property
    def coloraxis(self) -> dict[str, Any]:
        """Colours by asinh(error / width), with round numbers on both sides of zero."""
        round_ones = [digit * 10.0**power for power in range(-3, 6) for digit in (1, 2, 5)]
        inside = [value for value in round_ones if self.width <= value <= self.limit]
        kept = inside[:: -max(1, -(-len(inside) // TICKS))]
        ticks = np.array([*(-value for value in kept), 0.0, *kept[::-1]])
        end = float(np.arcsinh(self.limit / self.width))
        texts = [f"{value:g}" for value in ticks]
        bar = {"title": {"text": SIGN}, "tickvals": np.arcsinh(ticks / self.width).tolist(), "ticktext": texts}
        return {"cmin": -end, "cmax": end, "colorscale": ERROR_COLOURS, "colorbar": bar}


def of_run(
    name: str, scale: ErrorScale, height_um: tuple[float, float], edges: Edges, inks: int, planned: int
) -> Values:
    """The figures of a run by the part of the page that shows them.

    height_um: least and greatest height; edges: of blocks along x and y [mm]; inks: 0 if droplets are shares of blocks;
    planned: most droplets of a plan on a cell, 0 where no plan is known.
    """
    return {
        "final": values(error(name, scale)),
        "surface": values(surface(height_um[1])),
        "droplets": values(droplets(inks)),
        "error": values(error("Error", scale)),
        "section": values(section()),
        "solid": values(solid(scale, height_um, edges)),
        **({"plan": values(plan(planned))} if planned else {}),
    }


def error(title: str, scale: ErrorScale) -> go.Figure:
    """A map of errors; z: on the scale, customdata: in um."""
    return _map(title, "target - height %{customdata:.2f} µm", scale.coloraxis)


def surface(top_um: float) -> go.Figure:
    """A map of heights [um], on one scale for all layers."""
    colours = {"colorscale": HEIGHT_COLOURS, "cmin": 0, "cmax": top_um}
    return _map("Surface", "height %{z:.2f} µm", {**colours, "colorbar": {"title": {"text": "height [µm]"}}})


def droplets(inks: int) -> go.Figure:
    """A map of the droplets of a layer by ink, or for no ink of the share of cells with a droplet [%]."""
    if not inks:
        share = {"colorscale": INK_COLOURS[:2], "cmin": 0, "cmax": 100}
        return _map("Droplets", "%{z} %", {**share, "colorbar": {"title": {"text": "cells with a droplet [%]"}}})
    words = ("none", "droplet") if inks == 1 else ("none", "ink A", "ink B")
    steps = [(at / len(words), INK_COLOURS[ink]) for ink in range(len(words)) for at in (ink, ink + 1)]
    bar = {"title": {"text": "jetted in the layer"}, "tickvals": list(range(len(words))), "ticktext": words}
    return _map("Droplets", "%{z}", {"colorscale": steps, "cmin": -0.5, "cmax": len(words) - 0.5, "colorbar": bar})


def plan(most: int) -> go.Figure:
    """A map of the droplets of a plan, over its layers."""
    colours = {"colorscale": INK_COLOURS[:2], "cmin": 0, "cmax": most}
    bar = {"title": {"text": "droplets in this layer<br>and the next ones"}, "dtick": 1}
    return _map("Plan", "%{z:.2~g} droplets", {**colours, "colorbar": bar})


def section() -> go.Figure:
    """Heights and errors along a cut: earlier layers, target, surface, error."""
    figure = make_subplots(rows=2, shared_xaxes=True, row_heights=(0.6, 0.4), vertical_spacing=0.1)
    lines = {
        "before": {"color": "#c9c9c9", "width": 0.7},
        "target": {"color": "#000", "width": 1, "dash": "4px,3px"},
        "surface": {"color": "#0b5fa5", "width": 2},
        "error": {"color": "#0b5fa5", "width": 1.5},
    }
    for name, line in lines.items():
        row = 2 if name == "error" else 1
        more: dict[str, Any] = {"hoverinfo": "skip"} if name == "before" else {"showlegend": row == 1}
        figure.add_scatter(name=name, line={"shape": "hvh", **line}, row=row, col=1, **more)
    figure.update_yaxes(title_text="height [µm]", rangemode="tozero", row=1)
    figure.update_yaxes(title_text="+ too low<br>- too high [µm]", zeroline=True, zerolinecolor="#000", row=2)
    return figure.update_layout(margin={"l": 70, "r": 10, "t": 64, "b": 42})


def solid(scale: ErrorScale, height_um: tuple[float, float], edges: Edges) -> go.Figure:
    """The surface in 3D: its body in grey, and the tops of the part in the colours of their errors."""
    x, y = ((each[0], each[-1]) for each in edges)
    per_mm = _SOLID_WIDTH / max(x[1] - x[0], y[1] - y[0])
    stretch = _SOLID_HEIGHT / (height_um[1] - height_um[0]) / per_mm * UM_PER_M / MM_PER_M
    look: dict[str, Any] = {"flatshading": True, "hovertemplate": PLACE + "height %{z:.1f} µm<extra></extra>"}
    body = {"ambient": 0.45, "diffuse": 0.65, "specular": 0}
    light = {"x": 70000, "y": -20000, "z": 100000}  # from above and the right, so that ground and walls differ
    tops = {"ambient": 0.95, "diffuse": 0.1, "specular": 0}
    return go.Figure(
        [
            go.Mesh3d(color="#b4b4b4", lighting=body, lightposition=light, **look),
            go.Mesh3d(coloraxis="coloraxis", intensitymode="cell", lighting=tops, **look),
        ],
        {
            "margin": {"l": 0, "r": 0, "t": 34, "b": 84},
            "title": {"text": f"Surface in 3D, heights \u00d7 {float(f'{stretch:.2g}'):g}"},
            "coloraxis": {**scale.coloraxis, "colorbar": {**scale.coloraxis["colorbar"], "y": -0.02}},
            "uirevision": "camera",
            "scene": {
                "aspectmode": "manual",
                "aspectratio": {"x": per_mm * (x[1] - x[0]), "y": per_mm * (y[1] - y[0]), "z": _SOLID_HEIGHT},
                "camera": {"eye": {"x": 0.94, "y": -1.38, "z": 0.99}, "center": {"x": 0, "y": 0, "z": -0.15}},
                "xaxis": {"title": {"text": "x [mm]"}, "range": x},
                "yaxis": {"title": {"text": "y [mm]"}, "range": y},
                "zaxis": {"title": {"text": "height [µm]"}, "nticks": 5, "range": height_um},
            },
        },
    )


def values(figure: go.Figure) -> Values:
    """A figure for the page."""
    found: Values = figure.to_dict()
    del found["layout"]["template"]
    return found


def plain(text: str) -> str:
    """A text of the user for Plotly, which interprets some markup: all of it is escaped."""
    return html.escape(text, quote=False)


def _map(title: str, hover: str, colours: Mapping[str, Any]) -> go.Figure:
    axis = {"constrain": "domain", "showgrid": False, "ticks": "outside"}
    layout = {
        "title": {"text": plain(title)},
        "coloraxis": colours,
        "xaxis": {**axis, "title": {"text": "x [mm]"}},
        "yaxis": {**axis, "title": {"text": "y [mm]"}, "scaleanchor": "x"},
        "margin": {"l": 46, "r": 10, "t": 44, "b": 106},
        "plot_bgcolor": "#ececec",
        "hovermode": "closest",
    }
    return go.Figure(go.Heatmap(coloraxis="coloraxis", hovertemplate=f"{PLACE}{hover}<extra></extra>"), layout)
