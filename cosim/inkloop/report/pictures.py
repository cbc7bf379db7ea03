"""The pictures of a run folder: which ones a run has, and the files they are in."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib import rc_context
from matplotlib.figure import Figure

from inkloop.report import plot
from inkloop.report.model_difference import ModelDifference
from inkloop.report.plot import COLOURS, WIDTH_IN
from inkloop.results.result import Result
from inkloop.units import MM_PER_M, UM_PER_M


def draw(folder: Path, runs: Mapping[str, Result], difference: ModelDifference | None) -> None:
    """Write the pictures of a run, the first of `runs`, and of its comparison runs into `folder`.

    difference: of a run on devices, its surfaces less those of the model.
    """
    with rc_context(plot.STYLE):
        figures = pictures(runs)
        if difference:
            name, run = next(iter(_labelled(runs).items()))
            figures["hardware-against-model"] = hardware_against_model(run, difference, name)
        for name, figure in figures.items():
            plot.save(figure, folder / f"{name}.png")


def draw_comparison(runs: Mapping[str, Result], picture: Path) -> None:
    """Write one picture of several runs of one grid."""
    with rc_context(plot.STYLE):
        plot.save(plot.comparison(_labelled(runs)), picture)


def pictures(runs: Mapping[str, Result]) -> dict[str, Figure]:
    """File name -> figure."""
    labelled = _labelled(runs)
    name, main = next(iter(labelled.items()))
    figures = {
        "surface": plot.surfaces({name: main}),
        "cross-section": plot.cross_section(labelled),
        "error-map": plot.error_map(main, name),
        "layers": plot.layers(labelled),
    }
    if len(labelled) > 1:
        figures["open-against-closed"] = plot.surfaces(labelled)
    if "growth_divergence" in main:
        figures["divergence"] = plot.divergence(labelled)
    if "ink" in main:
        figures["materials"] = plot.materials(main, name)
        figures["solid"] = plot.solids(labelled)
    return figures


def _labelled(runs: Mapping[str, Result]) -> dict[str, xr.Dataset]:
    """The data of each run by its label; a dollar sign in it begins no formula."""
    return {name.replace("$", r"\$"): result.dataset for name, result in runs.items()}


MAPS = 4
"""Layers that are shown, the last one among them."""


def hardware_against_model(run: xr.Dataset, found: ModelDifference, name: str) -> Figure:
    """Measured less model: above the maps of some layers, below mean, rms, worst cell and growth by layer."""
    layers = [row.layer for row in found.rows]
    printed = [layer for layer in layers if layer > 0] or layers
    places = np.linspace(0, len(printed) - 1, min(MAPS, len(printed))).round().astype(int)
    shown = [printed[place] for place in places]
    limit = max(1e-3, float(np.nanquantile(np.abs(found.maps[shown]) * UM_PER_M, 0.99)))
    figure = Figure(figsize=(WIDTH_IN, 4.4), layout="constrained")
    above, below = np.ravel(np.asarray(figure.subfigures(2, 1, height_ratios=(5, 6)), dtype=object))
    maps = above.subplots(1, len(shown), squeeze=False)[0]
    half = float(run.attrs["pitch"]) / 2 * MM_PER_M
    x, y = run.x.values * MM_PER_M, run.y.values * MM_PER_M
    extent = (x[0] - half, x[-1] + half, y[0] - half, y[-1] + half)
    for axes, layer in zip(maps, shown, strict=True):
        image = axes.imshow(
            found.maps[layer].T * UM_PER_M,
            origin="lower",
            extent=extent,
            interpolation="nearest",
            cmap="RdBu_r",
            vmin=-limit,
            vmax=limit,
        )
        axes.set(title=f"layer {layer}", xlabel="x [mm]")
    maps[0].set_ylabel("y [mm]")
    above.suptitle(f"{name}: measured less {found.model}", fontsize=8)
    above.colorbar(image, ax=list(maps), label="measured - model [µm]", extend="both")
    axes = below.subplots()
    lines = {
        "mean": [row.mean for row in found.rows],
        "rms": [row.rms for row in found.rows],
        "rms of the layer's growth": [row.growth for row in found.rows],
        "worst cell": [row.worst for row in found.rows],
    }
    for (label, values), colour in zip(lines.items(), COLOURS, strict=False):
        style = {"marker": ".", "linestyle": "none"} if label == "worst cell" else {"linewidth": 1.4}
        axes.plot(layers, np.array(values) * UM_PER_M, label=label, color=colour, **style)
    axes.axhline(0, color="black", linestyle="--", linewidth=0.8)
    axes.set(xlabel="layer", ylabel="measured - model [µm]")
    axes.legend(ncols=4, loc="upper center", bbox_to_anchor=(0.5, 1.14), frameon=False)
    axes.grid(color="0.92")
    return figure
