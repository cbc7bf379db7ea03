"""A print in two inks: a cut that shows the inks, and the solid without its support."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from inkloop.component import FloatMap
from inkloop.report.plot import ERROR_COLOURS, MATERIAL_COLOURS, Runs, add_scale, error_norm, middle_row, new_figure
from inkloop.report.solid_view import View, view
from inkloop.results.solid import STEP_M, ink_error, voxels
from inkloop.units import MM_PER_M, UM_PER_M

__all__ = ["solids"]

SOLID_UPRIGHT = 0.45  # height of a solid's picture as a share of its width: parts are far wider than high
SCALE_SHARE = 0.25  # length of a scale bar, at most, as a share of the part's size
SCALE_ROOM = 0.16  # share of the picture's width for the scale bars, left of the part
HEADROOM = 1.04


def materials(run: xr.Dataset, name: str) -> Figure:
    """Cut through the middle of a print in two inks: the ink at each height, and the wanted region of A."""
    row = middle_row(run)
    cut = voxels(run.isel(y=[row]))[:, 0]
    figure = new_figure(2.6)
    axes = figure.subplots()
    half = float(run.attrs["pitch"]) / 2 * MM_PER_M
    x = run.x.values * MM_PER_M
    top = cut.shape[1] * STEP_M * UM_PER_M
    extent = (x[0] - half, x[-1] + half, 0.0, top)
    axes.imshow(cut.T, origin="lower", extent=extent, interpolation="nearest", cmap=MATERIAL_COLOURS, vmin=0, vmax=2)
    handles: list[Artist] = [Patch(color=MATERIAL_COLOURS(n), label=f"ink {ink}") for n, ink in ((1, "A"), (2, "B"))]
    line: dict[str, Any] = {"color": "black", "linewidth": 0.9}
    for bottom, upper in zip(run.region_bottom[:, :, row].values, run.region_top[:, :, row].values, strict=True):
        within = run.mask[:, row].values.astype(bool) & ~np.isnan(bottom)
        for edge in (np.maximum(bottom, 0.0), np.minimum(upper, run.target_height[:, row].values)):
            axes.step(x, np.where(within, edge * UM_PER_M, np.nan), where="mid", **line)
    handles.append(Line2D([], [], label="bounds of ink A\nin the part", **line))
    axes.set_aspect("auto")
    axes.set(xlabel="x [mm]", ylabel="height [µm]", ylim=(0.0, HEADROOM * top))
    axes.set_title(f"{name}: cut at y = {float(run.y[row]) * MM_PER_M:.2f} mm")
    figure.legend(handles=handles, loc="outside right center", frameon=False)
    return figure


def solids(runs: Runs) -> Figure:
    """Prints in two inks without ink B, the support; coloured where ink A is missing or too much.

    Heights are stretched, as the scale bars of each picture show.
    """
    figure = new_figure(2.8)
    views = [view(voxels(run) == 1, SOLID_UPRIGHT) for run in runs.values()]
    errors = [_seen_error(run, seen) for run, seen in zip(runs.values(), views, strict=True)]
    colours = ScalarMappable(error_norm(errors), ERROR_COLOURS)
    inside = np.logical_or.reduce([~np.isnan(seen.brightness) for seen in views])
    frame = np.ix_(inside.any(1), inside.any(0))  # one for all, so that sizes can be compared
    columns = figure.subplots(1, len(runs), squeeze=False)[0]
    for axes, seen, error, (name, run) in zip(columns, views, errors, runs.items(), strict=True):
        light = seen.brightness[frame]
        surface = colours.to_rgba(np.nan_to_num(error[frame]))[..., :3] * np.nan_to_num(light)[..., None]
        image = np.concatenate([surface, ~np.isnan(light)[..., None]], axis=-1)
        axes.imshow(image, origin="lower")
        axes.set_title(f"{name}\nmismatch {float(run.mismatch):.1%}")
        axes.set_axis_off()
        top = voxels(run).shape[2] * STEP_M
        draw_scales(axes, seen, max(run.sizes["x"], run.sizes["y"]) * float(run.attrs["pitch"]), top / SOLID_UPRIGHT)
    add_scale(figure, colours, "error of ink A [µm]", ("missing", "too much"), ax=list(columns), shrink=0.7)
    return figure


def _seen_error(run: xr.Dataset, seen: View) -> FloatMap:
    """The error of ink A at each pixel [um], NaN where no solid is visible."""
    error = ink_error(run)[tuple(np.moveaxis(seen.voxel, -1, 0))] * UM_PER_M
    return np.asarray(np.where(np.isnan(seen.brightness), np.nan, error))


def draw_scales(axes: Axes, seen: View, width_m: float, stretched_m: float) -> None:
    """A bar along x, y and z in the lower left corner, each with its length.

    width_m: longer side of the solid; stretched_m: the height that would be drawn as long as that side.
    """
    flat = _round_length(SCALE_SHARE * width_m * MM_PER_M) / MM_PER_M
    high = _round_length(SCALE_SHARE * SOLID_UPRIGHT * stretched_m * UM_PER_M) / UM_PER_M
    ends = seen.axes * np.array([flat / width_m, flat / width_m, high / stretched_m])[:, None]
    left, right = axes.get_xlim()
    low, up = axes.get_ylim()
    room = SCALE_ROOM * (right - left)
    axes.set_xlim(left - room, right)
    axes.set_ylim(low - max(0.0, -float(ends[:, 1].min())), up)
    words = (f"{flat * MM_PER_M:g} mm", f"{flat * MM_PER_M:g} mm", f"{high * UM_PER_M:g} µm")
    for (x, y), word, side in zip(ends, words, ("left", "left", "right"), strict=True):
        axes.plot([left - room, left - room + x], [low, low + y], color="black", linewidth=1.0, clip_on=False)
        place: dict[str, Any] = {"ha": side, "va": "bottom", "fontsize": 6, "annotation_clip": False}
        axes.annotate(word, (left - room + x, low + y), (1, 1), textcoords="offset points", **place)


def _round_length(most: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above `most`."""
    power = 10.0 ** math.floor(math.log10(most))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= most * (1.0 + 1e-9))
