"""Pictures of a run, made for print: heights in micrometres, positions in millimetres, one colour per run.

Every function takes results as labelled arrays (see `inkloop.result`) and returns a figure; `save` writes it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d.axes3d import Axes3D

from inkloop.component import FloatMap
from inkloop.files import replaced

UM, MM = 1e6, 1e3
WIDTH_IN = 7.0
COLOURS = ("#0b5fa5", "#c8541b", "#3a7d44", "#7b4b94", "#8a6d1f")
MATERIAL_COLOURS = ListedColormap(["#ffffff00", "#0b5fa5", "#e3c9a0"])
Runs = Mapping[str, xr.Dataset]


def save(figure: Figure, path: Path) -> None:
    """Write a PNG to a temporary name, then put it in place."""
    with replaced(path) as partial:
        figure.savefig(partial, dpi=200, format="png", facecolor="white")


def surfaces(runs: Runs) -> Figure:
    """Final surfaces side by side on one height scale, at most three."""
    shown = dict(list(runs.items())[:3])
    top = max(float(run.height[-1].max()) for run in shown.values()) * UM
    figure = _figure(3.1)
    for place, (name, run) in enumerate(shown.items(), start=1):
        axes = figure.add_subplot(1, len(shown), place, projection="3d")
        assert isinstance(axes, Axes3D)
        x, y = np.meshgrid(run.x * MM, run.y * MM, indexing="ij")
        axes.plot_surface(
            x, y, run.height[-1].values * UM, cmap="viridis", vmin=0, vmax=top, rcount=200, ccount=200, linewidth=0.1
        )
        axes.set(zlim=(0, top * 1.05), xlabel="x [mm]", ylabel="y [mm]")
        axes.set_zlabel("height [µm]")
        axes.set_box_aspect((1, 1, 0.7), zoom=0.85)
        axes.view_init(elev=28, azim=-60)
        axes.tick_params(labelsize=7, pad=0)
        axes.set_title(f"{name}\n{_figures(run)}", fontsize=9)
    return figure


def cross_section(runs: Runs) -> Figure:
    """Cut through the middle of the part: whole height above, the top as an error below."""
    figure = _figure(4.4)
    whole, top = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    first = next(iter(runs.values()))
    row = _middle_row(first)
    x = first.x.values * MM
    for layer in range(0, first.sizes["layer"] - 1, max(1, first.sizes["layer"] // 10)):
        whole.plot(x, first.height[layer, :, row] * UM, color="0.8", linewidth=0.7)
    whole.plot(x, first.target_height[:, row] * UM, color="black", linestyle="--", linewidth=1, drawstyle="steps-mid")
    whole.annotate("target", (x[0], 0), (2, 4), textcoords="offset points", fontsize=8)
    for colour, (name, run) in zip(COLOURS, runs.items(), strict=False):
        height = run.height[-1, :, row] * UM
        whole.plot(x, height, color=colour, label=name)
        top.plot(x, (height - run.target_height[:, row] * UM).where(run.mask[:, row]), color=colour, marker=".", ms=3)
    whole.set(ylabel="height [µm]", ylim=(0, None), title=f"cut at y = {float(first.y[row]) * MM:.2f} mm")
    whole.legend(fontsize=8)
    top.axhline(0, color="black", linestyle="--", linewidth=1)
    top.set(xlabel="x [mm]", ylabel="height - target [µm]")
    return figure


def error_map(run: xr.Dataset, name: str) -> Figure:
    """Final height minus target over the part, and how it is distributed."""
    error = ((run.height[-1] - run.target_height) * UM).where(run.mask)
    limit = max(float(np.abs(error).quantile(0.99)), 1e-3)
    figure = _figure(3.2)
    plane, counts = figure.subplots(1, 2, width_ratios=(3, 2))
    image = _image(plane, run, error.values, vmin=-limit, vmax=limit, cmap="RdBu_r")
    figure.colorbar(image, ax=plane, label="height - target [µm]", extend="both")
    plane.set_title(f"{name}: {_figures(run)}", fontsize=9)
    inside = error.values[run.mask.values]
    counts.hist(inside, bins=40, color=COLOURS[0])
    counts.axvline(0, color="black", linestyle="--", linewidth=1)
    counts.set(xlabel="height - target [µm]", ylabel="cells")
    return figure


def layers(runs: Runs) -> Figure:
    """Mean height against the target, unevenness and droplets, layer by layer."""
    figure = _figure(5.2)
    mean, spread, droplets = figure.subplots(3, 1, sharex=True)
    for colour, (name, run) in zip(COLOURS, runs.items(), strict=False):
        layer = run.layer.values
        mean.plot(layer, run.mean_error * UM, color=colour, label=name)
        spread.semilogy(layer[1:], run["std"][1:] * UM, color=colour)
        droplets.step(layer[1:], (run.pattern[1:] != 0).sum(("x", "y")), color=colour, where="mid")
    mean.axhline(0, color="black", linestyle="--", linewidth=1)
    mean.set(ylabel="target - mean [µm]")
    mean.legend(fontsize=8)
    spread.set(ylabel="std over the part [µm]")
    droplets.set(ylabel="droplets", xlabel="layer", ylim=(0, None))
    for axes in (mean, spread, droplets):
        axes.grid(color="0.92")
    return figure


def materials(run: xr.Dataset, name: str) -> Figure:
    """Cut through the middle of a print in two inks: which ink fills it at each height."""
    row = _middle_row(run)
    height = run.height[:, :, row].values * UM
    ink = run.pattern[:, :, row].values
    levels = np.linspace(0.0, float(height.max()), 400)
    cut = np.zeros((height.shape[1], levels.size))
    for site in range(height.shape[1]):
        layer = np.searchsorted(height[:, site], levels, side="right").clip(max=len(height) - 1)
        filled = levels <= height[-1, site]
        cut[site] = np.where(filled, _ink_of_layer(ink[:, site])[layer], 0)
    figure = _figure(2.6)
    axes = figure.subplots()
    extent = (float(run.x[0]) * MM, float(run.x[-1]) * MM, 0.0, float(levels[-1]))
    axes.imshow(cut.T, origin="lower", extent=extent, aspect="auto", cmap=MATERIAL_COLOURS, vmin=0, vmax=2,
                interpolation="nearest")  # fmt: skip
    axes.set(xlabel="x [mm]", ylabel="height [µm]", title=f"{name}: cut at y = {float(run.y[row]) * MM:.2f} mm")
    inks = [Patch(color=MATERIAL_COLOURS(1), label="ink A"), Patch(color=MATERIAL_COLOURS(2), label="ink B")]
    axes.legend(handles=inks, fontsize=8, loc="upper right")
    return figure


def _ink_of_layer(ink: FloatMap) -> FloatMap:
    """Ink of each layer at one site; a layer without a droplet there takes the ink of the last droplet."""
    last = np.maximum.accumulate(np.where(ink != 0, np.arange(ink.size), 0))
    filled = ink[last]
    first = ink[np.flatnonzero(ink)[:1]]
    return np.where(filled == 0, first if first.size else 0, filled)


def _figure(height_in: float) -> Figure:
    return Figure(figsize=(WIDTH_IN, height_in), layout="constrained")


def _image(axes: Axes, run: xr.Dataset, values: FloatMap, **style: object):  # type: ignore[no-untyped-def]
    half = float(run.attrs.get("pitch", 0.0)) / 2 * MM
    x, y = run.x.values * MM, run.y.values * MM
    extent = (x[0] - half, x[-1] + half, y[0] - half, y[-1] + half)
    axes.set(xlabel="x [mm]", ylabel="y [mm]")
    return axes.imshow(values.T, origin="lower", extent=extent, interpolation="nearest", **style)


def _middle_row(run: xr.Dataset) -> int:
    """Index along y of the middle of the part."""
    return int(np.flatnonzero(run.mask.any("x")).mean().round())


def _figures(run: xr.Dataset) -> str:
    return f"mean error {float(run.mean_error[-1]) * UM:.2f}, std {float(run['std'][-1]) * UM:.2f} µm"
