"""Picture of the differences between hardware and model, by place and layer."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from inkloop.report.model_difference import SIGN, ModelDifference
from inkloop.report.plot import DOTTED, add_scale, draw_error, draw_line, extent_of, new_figure
from inkloop.units import UM_PER_M

MAPS = 4
"""Number of layers shown, the last one included."""


def hardware_against_model(run: xr.Dataset, found: ModelDifference, name: str) -> Figure:
    """Scans minus the model: above the maps of some layers, below mean, rms, worst cell and growth by layer."""
    layers = [row.layer for row in found.rows]
    printed = [layer for layer in layers if layer > 0] or layers
    places = np.linspace(0, len(printed) - 1, min(MAPS, len(printed))).round().astype(int)
    shown = [printed[place] for place in places]
    limit = max(1e-3, float(np.nanquantile(np.abs(found.maps[shown]) * UM_PER_M, 0.99)))
    figure = new_figure(4.6)
    above, below = np.ravel(np.asarray(figure.subfigures(2, 1, height_ratios=(5, 6)), dtype=object))
    maps = above.subplots(1, len(shown), squeeze=False)[0]
    for axes, layer in zip(maps, shown, strict=True):
        image = draw_error(axes, found.maps[layer] * UM_PER_M, extent_of(run), Normalize(-limit, limit), "RdBu_r")
        axes.set(title=f"layer {layer}", xlabel="x [mm]")
    maps[0].set_ylabel("y [mm]")
    above.suptitle(f"{name}: hardware minus {found.model}", fontsize=8)
    add_scale(
        above, image, "hardware minus model [µm]", ("hardware\nhigher" + DOTTED, "hardware\nlower"), ax=list(maps)
    )
    axes = below.subplots()
    lines = {
        "mean": [row.mean for row in found.rows],
        "rms": [row.rms for row in found.rows],
        "rms of the layer's growth": [row.growth for row in found.rows],
        "worst cell": [row.worst for row in found.rows],
    }
    for number, (label, values) in enumerate(lines.items()):
        style = {"linestyle": ""} if label == "worst cell" else {}
        draw_line(axes, number, np.array(layers), np.array(values) * UM_PER_M, label, ends=False, **style)
    axes.axhline(0, color="black", linestyle="--", linewidth=0.8)
    axes.set(xlabel="layer", ylabel=f"hardware minus model [µm]\n({SIGN})")
    axes.legend(ncols=4, loc="upper center", bbox_to_anchor=(0.5, 1.14), frameon=False)
    axes.grid(color="0.92")
    return figure
