"""Final surfaces as they were printed, in three dimensions."""

from __future__ import annotations

import math

import numpy as np
import xarray as xr
from matplotlib.cm import ScalarMappable
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.axes3d import Axes3D

from inkloop.component import FloatMap
from inkloop.report.page.maps import block_means
from inkloop.report.plot import ERROR_COLOURS, WIDTH_IN, Runs, add_scale, error_norm, extent_of, figures_of
from inkloop.results.metrics import error_of
from inkloop.units import MM_PER_M, UM_PER_M

__all__ = ["surfaces"]

PLATES = 100  # along a side at most; larger maps are shown as means of blocks
BOX_UPRIGHT = 0.45  # height of the box as a share of its longer side
WALL_COLOURS = ("0.75", "0.6")  # walls that face x and y


def surfaces(runs: Runs) -> Figure:
    """Final surfaces as printed, each cell a plate, its top coloured by the error on one scale; at most three runs.

    The colours of several runs grow with the logarithm of the error, so that errors of a hundredth of the largest are
    visible.
    """
    shown = dict(list(runs.items())[:3])
    errors = {name: error_of(run) for name, run in shown.items()}
    colours = ScalarMappable(error_norm(list(errors.values())), ERROR_COLOURS)
    top = max(max(float(run.height[-1].max()) for run in shown.values()) * UM_PER_M, 1e-3)
    count = len(shown)
    figure = Figure(figsize=(WIDTH_IN, 2.2) if count > 1 else (4.6, 3.0))
    width = (0.89 if count > 1 else 0.82) / count
    for place, (name, run) in enumerate(shown.items()):
        axes = figure.add_axes((place * width, -0.04, width, 1.0), projection="3d")
        assert isinstance(axes, Axes3D)
        _plates(axes, run, errors[name], colours, zoom=0.88 if count > 1 else 0.97)
        axes.set_zlim(0, top * 1.02)
        if count == 1:  # there is no room for it between two pictures
            axes.set_zlabel("height [µm]", labelpad=-3)
        figure.text((place + 0.5) * width, 0.98, f"{name}\n{figures_of(run)}", ha="center", va="top", fontsize=8)
    scale = figure.add_axes((0.913 if count > 1 else 0.86, 0.32, 0.012 * WIDTH_IN / figure.get_figwidth(), 0.42))
    add_scale(figure, colours, cax=scale)
    stretched = BOX_UPRIGHT * _longer_side(next(iter(shown.values()))) / MM_PER_M * UM_PER_M / top
    figure.text(
        0.99, 0.02, f"heights in µm, stretched x {float(f'{stretched:.2g}'):g}", ha="right", fontsize=7, color="0.4"
    )
    return figure


def _plates(axes: Axes3D, run: xr.Dataset, error: FloatMap, colours: ScalarMappable, zoom: float) -> None:
    block = max(1, math.ceil(max(error.shape) / PLATES))
    height, shown = block_means(run.height[-1].values * UM_PER_M, block), block_means(error, block)
    left, right, bottom, top = extent_of(run)
    edges = [
        np.repeat(np.minimum(first + np.arange(count + 1) * block * (last - first) / cells, last), 2)[1:-1]
        for first, last, count, cells in zip((left, bottom), (right, top), height.shape, error.shape, strict=True)
    ]
    x, y = np.meshgrid(*edges, indexing="ij")
    plates = np.repeat(np.repeat(height, 2, axis=0), 2, axis=1)
    faces = np.empty((plates.shape[0] - 1, plates.shape[1] - 1, 4))
    faces[:] = to_rgba(WALL_COLOURS[0])
    faces[:, 1::2] = to_rgba(WALL_COLOURS[1])
    faces[::2, ::2] = np.where(np.isnan(shown)[..., None], to_rgba("0.96"), colours.to_rgba(np.nan_to_num(shown)))
    # as thin a line as closes the seams; in a PDF or an SVG the faces are one image
    drawn = axes.plot_surface(x, y, plates, rstride=1, cstride=1, linewidth=0.15, shade=False, rasterized=True)
    drawn.set_facecolor(faces.reshape(-1, 4))  # plot_surface takes each colour by itself: a second for two pictures
    drawn.set_edgecolor(faces.reshape(-1, 4))
    axes.set_xlabel("x [mm]", labelpad=-4)
    axes.set_ylabel("y [mm]", labelpad=-4)
    axes.tick_params(pad=-2)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MaxNLocator(4))
    longer = _longer_side(run)
    axes.set_box_aspect(((right - left) / longer, (top - bottom) / longer, BOX_UPRIGHT), zoom=zoom)
    axes.view_init(elev=32, azim=-60)
    axes.patch.set_visible(False)  # it would hide labels of the picture to its left
    axes.grid(False)


def _longer_side(run: xr.Dataset) -> float:
    """Of the grid [mm]."""
    left, right, bottom, top = extent_of(run)
    return max(right - left, top - bottom)
