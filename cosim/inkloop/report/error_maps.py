"""Maps of the error over the part: of one run with its distribution, and of several runs on one scale."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from inkloop.report.layer_curves import draw_layers
from inkloop.report.plot import (
    COLOURS,
    DOTTED,
    ERROR_LABEL,
    WIDTH_IN,
    Runs,
    add_scale,
    draw_error,
    error_norm,
    error_of,
    extent_of,
    figures_of,
    new_figure,
    outside_legend,
)
from inkloop.results.metrics import TOO_HIGH, TOO_LOW

MAP_IN = 2.3  # height of a map
SCALE_IN = 1.3  # share of its width for ticks, labels and the colour scale


def error_map(run: xr.Dataset, name: str) -> Figure:
    """The final error over the part, and its distribution."""
    error, (left, right, bottom, top) = error_of(run), extent_of(run)
    figure = new_figure(3.2)
    width = min(max(MAP_IN * (right - left) / (top - bottom) + SCALE_IN, 2.2), 0.62 * WIDTH_IN)
    plane, counts = figure.subplots(1, 2, width_ratios=(width, WIDTH_IN - width))
    image = draw_error(plane, error, (left, right, bottom, top), error_norm([error]))
    add_scale(figure, image, words=(TOO_LOW, TOO_HIGH + DOTTED), ax=plane)
    plane.set(xlabel="x [mm]", ylabel="y [mm]")
    figure.suptitle(f"{name}: {figures_of(run)}")
    limit = max(float(np.nanmax(np.abs(error))), 1e-3)
    counts.hist(error[~np.isnan(error)], bins=41, range=(-limit, limit), color=COLOURS[0])
    counts.axvline(0, color="black", linestyle="--", linewidth=1)
    counts.set(xlabel=ERROR_LABEL.replace("\n", " "), ylabel="cells")
    counts.yaxis.set_major_locator(MaxNLocator("auto", integer=True))
    return figure


def comparison(runs: Runs) -> Figure:
    """Final error maps on one scale; below them mean error, unevenness and droplets by layer."""
    errors = {name: error_of(run) for name, run in runs.items()}
    norm = error_norm(list(errors.values()))
    figure = new_figure(5.2)
    above, below = np.ravel(np.asarray(figure.subfigures(2, 1, height_ratios=(6, 5)), dtype=object))
    maps = above.subplots(1, len(runs), squeeze=False)[0]
    for axes, (name, run) in zip(maps, runs.items(), strict=True):
        image = draw_error(axes, errors[name], extent_of(run), norm)
        axes.set(xlabel="x [mm]", title="\n".join((name, *figures_of(run).split(", "))))
    maps[0].set_ylabel("y [mm]")
    add_scale(above, image, words=(TOO_LOW, TOO_HIGH + DOTTED), ax=list(maps))
    mean, spread, droplets = below.subplots(1, 3)
    draw_layers(mean, spread, droplets, runs)
    mean.set(title=f"mean {ERROR_LABEL}", xlabel="layer")
    spread.set(title="std over the part [µm]", xlabel="layer")
    droplets.set(title="droplets of the layer", xlabel="layer")
    for axes in (mean, spread, droplets):
        axes.xaxis.set_major_locator(MaxNLocator(4, integer=True))
    handles, labels = mean.get_legend_handles_labels()
    outside_legend(below, handles, labels)
    return figure
