"""Pictures of a run, made for print: heights in micrometres, positions in millimetres, one colour per run.

Every function takes results as labelled arrays (see `inkloop.results.result`) and returns a figure; `save` writes it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.cm import ScalarMappable
from matplotlib.colors import AsinhNorm, ListedColormap, Normalize, to_rgba
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, MaxNLocator
from mpl_toolkits.mplot3d.axes3d import Axes3D

from inkloop.component import FloatMap
from inkloop.files import replaced
from inkloop.report.solid_view import view
from inkloop.results.solid import STEP_M, voxels
from inkloop.units import MM_PER_M, UM_PER_M

WIDTH_IN = 7.0
COLOURS = ("#0b5fa5", "#c8541b", "#3a7d44", "#7b4b94", "#8a6d1f")
MATERIAL_COLOURS = ListedColormap(["#ffffff00", "#0b5fa5", "#e3c9a0"])
DASHES: tuple[Any, ...] = ((0, (5, 2)), (0, (1, 1)), (0, (5, 1.5, 1, 1.5)), (0, (8, 3)))
# The first run lies broad below, the others dashed above it, so that coinciding lines are visible, in grey print too.
LINES: tuple[dict[str, Any], ...] = (
    {"color": COLOURS[0], "linewidth": 2.4},
    *({"color": c, "linewidth": 1.3, "linestyle": dashes} for c, dashes in zip(COLOURS[1:], DASHES, strict=True)),
)
PLATES = 100  # along a side of a surface's picture at most; larger maps are shown as means of blocks
BOX_UPRIGHT = 0.45  # height of a surface's box as a share of its longer side
WALL_COLOURS = ("0.75", "0.6")  # walls that face x and y
FAR_UM = 10.0  # a run that misses by more than this is not drawn with the others
SOLID_UPRIGHT = 0.45  # height of a solid's picture as a share of its width: parts are far wider than high
STYLE: dict[Any, float] = {
    **dict.fromkeys(("font.size", "axes.titlesize", "axes.labelsize"), 8),
    **dict.fromkeys(("legend.fontsize", "xtick.labelsize", "ytick.labelsize"), 7),
    "axes.linewidth": 0.6,
}
Runs = Mapping[str, xr.Dataset]


def save(figure: Figure, path: Path) -> None:
    """Write a PNG to a temporary name, then put it in place."""
    with replaced(path) as partial:
        figure.savefig(partial, dpi=200, format="png", facecolor="white")


def surfaces(runs: Runs) -> Figure:
    """Final surfaces as printed, each cell a plate, its top coloured by the error on one scale; at most three runs.

    The colours of several runs grow with the logarithm of the error, so that errors of a hundredth of the largest are
    visible.
    """
    shown = dict(list(runs.items())[:3])
    errors = {name: _error(run) for name, run in shown.items()}
    colours = ScalarMappable(_norm(list(errors.values())), "RdBu")
    top = max(max(float(run.height[-1].max()) for run in shown.values()) * UM_PER_M, 1e-3)
    count = len(shown)
    figure = Figure(figsize=(WIDTH_IN, 2.2) if count > 1 else (4.6, 3.0))
    width = (0.89 if count > 1 else 0.82) / count
    for place, (name, run) in enumerate(shown.items()):
        axes = figure.add_axes((place * width, -0.06, width, 1.0), projection="3d")
        assert isinstance(axes, Axes3D)
        _plates(axes, run, errors[name], colours)
        axes.set_zlim(0, top * 1.02)
        if count == 1:  # there is no room for it between two pictures
            axes.set_zlabel("height [µm]", labelpad=-3)
        figure.text((place + 0.5) * width, 0.98, f"{name}\n{_figures(run)}", ha="center", va="top", fontsize=8)
    scale = figure.add_axes((0.91 if count > 1 else 0.83, 0.2, 0.012 * WIDTH_IN / figure.get_figwidth(), 0.5))
    _add_scale(figure, colours, cax=scale)
    stretched = BOX_UPRIGHT * _longer_side(next(iter(shown.values()))) / MM_PER_M * UM_PER_M / top
    figure.text(
        0.99, 0.02, f"heights in µm, stretched x {float(f'{stretched:.2g}'):g}", ha="right", fontsize=7, color="0.4"
    )
    return figure


def _plates(axes: Axes3D, run: xr.Dataset, error: FloatMap, colours: ScalarMappable) -> None:
    block = max(1, math.ceil(max(error.shape) / PLATES))
    height, shown = _means(run.height[-1].values * UM_PER_M, block), _means(error, block)
    left, right, bottom, top = _extent(run)
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
    axes.plot_surface(x, y, plates, facecolors=faces, rstride=1, cstride=1, linewidth=0, shade=False)
    axes.set_xlabel("x [mm]", labelpad=-4)
    axes.set_ylabel("y [mm]", labelpad=-4)
    axes.tick_params(pad=-2)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MaxNLocator(4))
    longer = _longer_side(run)
    axes.set_box_aspect(((right - left) / longer, (top - bottom) / longer, BOX_UPRIGHT), zoom=0.88)
    axes.view_init(elev=32, azim=-60)
    axes.patch.set_visible(False)  # it would hide labels of the picture to its left
    axes.grid(False)


def _norm(errors: Sequence[FloatMap]) -> Normalize:
    """One scale for the errors of several runs [um]: up to the largest, and fine enough for the smallest."""
    scales = [max(1e-3, float(np.nanquantile(np.abs(error), 0.99))) for error in errors]
    limit = max(scales)
    return Normalize(-limit, limit) if len(scales) == 1 else AsinhNorm(min(scales) / 2.0, -limit, limit)


def _add_scale(figure: Figure | SubFigure, colours: ScalarMappable, **place: Any) -> None:
    """The scale of `_norm`, with its decades."""
    bar = figure.colorbar(colours, label="target - height [µm]", extend="both", format="{x:g}", **place)
    norm = colours.norm
    if isinstance(norm, AsinhNorm) and norm.vmax is not None:
        decades = 10.0 ** np.arange(math.ceil(math.log10(norm.linear_width)), math.floor(math.log10(norm.vmax)) + 1)
        bar.set_ticks([*-decades[::-1], 0.0, *decades], minor=False)
        bar.minorticks_off()


def _means(values: FloatMap, block: int) -> FloatMap:
    """Means over blocks of cells, of those that have a number; NaN where none has."""
    if block == 1:
        return values
    sides = [np.arange(0, cells, block) for cells in values.shape]
    totals, counts = (
        np.add.reduceat(np.add.reduceat(each, sides[0], axis=0), sides[1], axis=1)
        for each in (np.nan_to_num(values), (~np.isnan(values)).astype(np.float64))
    )
    with np.errstate(invalid="ignore"):
        return np.asarray(totals / np.where(counts > 0.0, counts, np.nan))


def _longer_side(run: xr.Dataset) -> float:
    """Of the grid [mm]."""
    left, right, bottom, top = _extent(run)
    return max(right - left, top - bottom)


def cross_section(runs: Runs) -> Figure:
    """Cut through the middle of the part: whole height above, the top as an error below."""
    figure = _figure(4.4)
    whole, top = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    first = next(iter(runs.values()))
    row = _middle_row(first)
    x = first.x.values * MM_PER_M
    every = max(1, first.sizes["layer"] // 10)
    for layer in range(0, first.sizes["layer"] - 1, every):
        label = f"{next(iter(runs))}, every {every} layers" if layer == 0 and every > 1 else None
        whole.plot(x, first.height[layer, :, row] * UM_PER_M, color="0.8", linewidth=0.7, label=label)
    target = first.target_height[:, row] * UM_PER_M
    whole.plot(x, target, color="black", linestyle="--", linewidth=1, drawstyle="steps-mid", label="target")
    errors = {name: _error(run)[:, row] for name, run in runs.items()}
    near = [error for error in errors.values() if abs(np.nanmean(error)) < FAR_UM] or list(errors.values())
    limit = max(0.1, *(1.2 * float(np.nanmax(np.abs(error))) for error in near))
    for line, (name, run) in zip(LINES, runs.items(), strict=False):
        whole.plot(x, run.height[-1, :, row] * UM_PER_M, label=name, **line)
        top.plot(x, errors[name], marker=".", ms=4, **line)
        mean = float(np.nanmean(errors[name]))
        if abs(mean) > limit:
            text, place = f"{name}: {mean:+.0f} µm, out of the frame", (0.01, 0.05 if mean < 0 else 0.9)
            top.text(*place, text, color=line["color"], transform=top.transAxes)
    whole.set(ylabel="height [µm]", ylim=(0, None), title=f"cut at y = {float(first.y[row]) * MM_PER_M:.2f} mm")
    whole.legend(loc="lower center", ncols=2)
    top.axhline(0, color="black", linestyle="--", linewidth=1)
    top.set(xlabel="x [mm]", ylabel="target - height [µm]", ylim=(-limit, limit))
    return figure


def error_map(run: xr.Dataset, name: str) -> Figure:
    """Target minus final height over the part, and how it is distributed."""
    error = _error(run)
    limit = max(float(np.nanquantile(np.abs(error), 0.99)), 1e-3)
    figure = _figure(3.2)
    plane, counts = figure.subplots(1, 2, width_ratios=(3, 2))
    image = plane.imshow(
        error.T, origin="lower", extent=_extent(run), interpolation="nearest", cmap="RdBu", vmin=-limit, vmax=limit
    )
    figure.colorbar(image, ax=plane, label="target - height [µm]", extend="both")
    plane.set(xlabel="x [mm]", ylabel="y [mm]", title=f"{name}: {_figures(run)}")
    counts.hist(error[~np.isnan(error)], bins=30, color=COLOURS[0])
    counts.axvline(0, color="black", linestyle="--", linewidth=1)
    counts.set(xlabel="target - height [µm]", ylabel="cells")
    return figure


def layers(runs: Runs) -> Figure:
    """How far the mean is from the target, unevenness and droplets, layer by layer."""
    figure = _figure(5.2)
    mean, spread, droplets = figure.subplots(3, 1, sharex=True)
    for line, (name, run) in zip(LINES, runs.items(), strict=False):
        layer = run.layer.values
        mean.plot(layer, np.abs(run.mean_error) * UM_PER_M, label=name, **line)
        spread.plot(layer[1:], run["std"][1:] * UM_PER_M, **line)
        if "pattern" in run:  # a print without a controller has none
            jetted = (run.pattern[1:] != 0).sum(("x", "y"))
            droplets.plot(layer[1:], jetted, drawstyle="steps-mid", **line)
    mean.set(ylabel="|target - mean| [µm]")
    mean.legend()
    spread.set(ylabel="std over the part [µm]")
    if any((run["std"][1:] > 0.0).any() for run in runs.values()):  # not where nothing was printed
        mean.set(yscale="log")
        spread.set(yscale="log")
        spread.yaxis.set_minor_locator(LogLocator(subs=(2, 5)))
        spread.yaxis.set_minor_formatter("{x:g}")
    droplets.set(ylabel="droplets", xlabel="layer", ylim=(0, None))
    for axes in (mean, spread):
        axes.yaxis.set_major_formatter("{x:g}")
    droplets.xaxis.set_major_locator(MaxNLocator(integer=True))
    for axes in (mean, spread, droplets):
        axes.grid(color="0.92")
    return figure


def divergence(runs: Runs) -> Figure:
    """How far the scans are from the shadow's model, layer by layer: of the layer, and of the whole surface.

    A ring stands where the status was untrusted or a fault.
    """
    figure = _figure(3.8)
    growth, surface = figure.subplots(2, 1, sharex=True)
    for line, (name, run) in zip(LINES, runs.items(), strict=False):
        if "growth_divergence" not in run:
            continue
        layer, of_layer = run.layer.values, run.growth_divergence.values * UM_PER_M
        growth.plot(layer, of_layer, label=name, **line)
        surface.plot(layer, run.surface_divergence * UM_PER_M, **line)
        alarmed = run.shadow_status.values > 0
        growth.plot(layer[alarmed], of_layer[alarmed], "o", ms=7, mfc="none", mec=line["color"], clip_on=False)
    growth.set(ylabel="of the layer [µm]", ylim=(0, None), title="scan against the shadow's model, rms over the part")
    growth.legend()
    surface.set(ylabel="of the surface [µm]", xlabel="layer", ylim=(0, None))
    for axes in (growth, surface):
        axes.grid(color="0.92")
    return figure


def materials(run: xr.Dataset, name: str) -> Figure:
    """Cut through the middle of a print in two inks: which ink fills it at each height."""
    row = _middle_row(run)
    cut = voxels(run.isel(y=[row]))[:, 0]
    figure = _figure(2.6)
    axes = figure.subplots()
    extent = (float(run.x[0]) * MM_PER_M, float(run.x[-1]) * MM_PER_M, 0.0, cut.shape[1] * STEP_M * UM_PER_M)
    axes.imshow(cut.T, origin="lower", extent=extent, interpolation="nearest", cmap=MATERIAL_COLOURS, vmin=0, vmax=2)
    axes.set_aspect("auto")
    axes.set(xlabel="x [mm]", ylabel="height [µm]", title=f"{name}: cut at y = {float(run.y[row]) * MM_PER_M:.2f} mm")
    inks = [Patch(color=MATERIAL_COLOURS(1), label="ink A"), Patch(color=MATERIAL_COLOURS(2), label="ink B")]
    axes.legend(handles=inks, loc="center left", bbox_to_anchor=(1, 0.5))
    return figure


def solids(runs: Runs) -> Figure:
    """Prints in two inks after ink B, the support, is washed away; heights stretched."""
    figure = _figure(2.6)
    views = [view(voxels(run) == 1, SOLID_UPRIGHT) for run in runs.values()]
    seen = np.logical_or.reduce([~np.isnan(image) for image in views])
    frame = np.ix_(seen.any(1), seen.any(0))  # one for all, so that sizes can be compared
    columns = figure.subplots(1, len(runs), squeeze=False)[0]
    for axes, image, (name, run) in zip(columns, views, runs.items(), strict=True):
        axes.imshow(image[frame], origin="lower", cmap="gray", vmin=0, vmax=1)
        axes.set_title(f"{name}\nmismatch {float(run.mismatch):.1%}")
        axes.set_axis_off()
    return figure


def comparison(runs: Runs) -> Figure:
    """Final error maps on one scale; below them error, unevenness and droplets by layer."""
    errors = {name: _error(run) for name, run in runs.items()}
    norm = _norm(list(errors.values()))
    figure = _figure(5.0)
    above, below = np.ravel(np.asarray(figure.subfigures(2, 1, height_ratios=(6, 5)), dtype=object))
    maps = above.subplots(1, len(runs), squeeze=False)[0]
    for axes, (name, run) in zip(maps, runs.items(), strict=True):
        image = axes.imshow(
            errors[name].T,
            origin="lower",
            extent=_extent(run),
            interpolation="nearest",
            cmap="RdBu",
            norm=norm,
        )
        axes.set(xlabel="x [mm]", title="\n".join((name, *_figures(run).split(", "))))
    maps[0].set_ylabel("y [mm]")
    _add_scale(above, image, ax=list(maps))
    mean, spread, droplets, names = below.subplots(1, 4)
    for number, (name, run) in enumerate(runs.items()):
        line = LINES[number % len(LINES)]
        layer = run.layer.values
        mean.plot(layer, np.abs(run.mean_error) * UM_PER_M, label=name, **line)
        spread.plot(layer[1:], run["std"][1:] * UM_PER_M, **line)
        if "pattern" in run:
            droplets.plot(layer[1:], (run.pattern[1:] != 0).sum(("x", "y")), drawstyle="steps-mid", **line)
    mean.set(title="|target - mean| [µm]", xlabel="layer", yscale="log")
    spread.set(title="std over the part [µm]", xlabel="layer", yscale="log")
    droplets.set(title="droplets of the layer", xlabel="layer", ylim=(0, None))
    names.legend(*mean.get_legend_handles_labels(), loc="center left", frameon=False)
    names.axis("off")
    for axes in (mean, spread, droplets):
        axes.xaxis.set_major_locator(MaxNLocator(4, integer=True))
    for axes in (mean, spread):
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_locator(LogLocator(subs=(2, 5)))
    spread.yaxis.set_minor_formatter("{x:g}")
    mean.yaxis.set_minor_formatter("")
    return figure


def _figure(height_in: float) -> Figure:
    return Figure(figsize=(WIDTH_IN, height_in), layout="constrained")


def _error(run: xr.Dataset) -> FloatMap:
    """Target minus final height [um] as in inkloop.results.metrics, NaN outside the part; red is too high."""
    error: FloatMap = ((run.target_height - run.height[-1]) * UM_PER_M).where(run.mask.astype(bool)).values
    return error


def _extent(run: xr.Dataset) -> tuple[float, float, float, float]:
    """Edges of the grid [mm]: left, right, bottom, top."""
    half = float(run.attrs["pitch"]) / 2 * MM_PER_M
    x, y = run.x.values * MM_PER_M, run.y.values * MM_PER_M
    return float(x[0] - half), float(x[-1] + half), float(y[0] - half), float(y[-1] + half)


def _middle_row(run: xr.Dataset) -> int:
    """Index along y of the middle of the part."""
    return int(np.flatnonzero(run.mask.any("x")).mean().round())


def _figures(run: xr.Dataset) -> str:
    return f"mean error {float(run.mean_error[-1]) * UM_PER_M:.2f}, std {float(run['std'][-1]) * UM_PER_M:.2f} µm"
