"""The picture of hardware against model: maps of chosen layers on one scale, and figures of all layers."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from inkloop.model_difference import ModelDifference
from inkloop.plot import COLOURS, MM, UM, WIDTH_IN

MAPS = 4
"""Layers that are shown, the last one among them."""


def hardware_against_model(run: xr.Dataset, found: ModelDifference, name: str) -> Figure:
    """Measured less model: above the maps of some layers, below mean, rms, worst cell and growth by layer."""
    layers = [row.layer for row in found.rows]
    printed = [layer for layer in layers if layer > 0] or layers
    places = np.linspace(0, len(printed) - 1, min(MAPS, len(printed))).round().astype(int)
    shown = [printed[place] for place in places]
    limit = max(1e-3, float(np.nanquantile(np.abs(found.maps[shown]) * UM, 0.99)))
    figure = Figure(figsize=(WIDTH_IN, 4.4), layout="constrained")
    above, below = np.ravel(np.asarray(figure.subfigures(2, 1, height_ratios=(5, 6)), dtype=object))
    maps = above.subplots(1, len(shown), squeeze=False)[0]
    half = float(run.attrs["pitch"]) / 2 * MM
    x, y = run.x.values * MM, run.y.values * MM
    extent = (x[0] - half, x[-1] + half, y[0] - half, y[-1] + half)
    for axes, layer in zip(maps, shown, strict=True):
        image = axes.imshow(found.maps[layer].T * UM, origin="lower", extent=extent, interpolation="nearest",
                            cmap="RdBu_r", vmin=-limit, vmax=limit)  # fmt: skip
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
        axes.plot(layers, np.array(values) * UM, label=label, color=colour, **style)
    axes.axhline(0, color="black", linestyle="--", linewidth=0.8)
    axes.set(xlabel="layer", ylabel="measured - model [µm]")
    axes.legend(ncols=4, loc="upper center", bbox_to_anchor=(0.5, 1.14), frameon=False)
    axes.grid(color="0.92")
    return figure
