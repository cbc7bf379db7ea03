"""Common parts of all pictures: size, colours, lines, the error of a run with its sign, and the file formats.

Pictures are made for print: heights in micrometres, positions in millimetres, one colour, dash and mark per run.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import xarray as xr
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import AsinhNorm, ListedColormap, Normalize
from matplotlib.figure import Figure, SubFigure
from matplotlib.image import AxesImage

from inkloop.component import FloatMap
from inkloop.files import replaced
from inkloop.report import FORMATS, PNG
from inkloop.report.page.maps import FINEST, block_means
from inkloop.report.terminal import decimals
from inkloop.results.metrics import SIGN, TOO_HIGH, TOO_LOW
from inkloop.units import MM_PER_M, UM_PER_M

__all__ = ["COLOURS", "LINES", "MARKS", "STYLE", "WIDTH_IN", "new_figure", "outside_legend", "save"]

WIDTH_IN, DPI = 7.0, 200
COLOURS = ("#0b5fa5", "#c8541b", "#3a7d44", "#7b4b94", "#8a6d1f")
MATERIAL_COLOURS = ListedColormap(["#ffffff00", "#0b5fa5", "#e3c9a0"])
DASHES: tuple[Any, ...] = ((0, (5, 2)), (0, (1, 1)), (0, (5, 1.5, 1, 1.5)), (0, (8, 3)))
# The first run lies broad below, the others dashed above it, so that coinciding lines are visible, in grey print too.
LINES: tuple[dict[str, Any], ...] = (
    {"color": COLOURS[0], "linewidth": 2.2},
    *({"color": c, "linewidth": 1.2, "linestyle": dashes} for c, dashes in zip(COLOURS[1:], DASHES, strict=True)),
)
MARKS = ("o", "s", "^", "D", "v")
MARKS_ON_A_LINE = 7
ERROR_COLOURS = "RdBu"
"""Red is too high, blue too low."""
DOTTED = "\n(dots)"
"""Label of the red end of a scale: red and blue are equally dark in grey print."""
DOTS = 64
"""Largest number of dots along the longer side of a map; on finer grids a dot marks a block of cells."""
NEXT_LABEL = 0.1
"""Share of the length of a scale: labels closer together overlap on a short one."""
CLEARLY_RED, DARK = 0.2, 0.4
"""Difference of red and blue, and brightness, from 0 to 1: above them a colour is marked, and with a white dot."""
ERROR_LABEL = f"error [µm]\n({SIGN})"
STYLE: dict[Any, Any] = {
    **dict.fromkeys(("font.size", "axes.titlesize", "axes.labelsize"), 8),
    **dict.fromkeys(("legend.fontsize", "xtick.labelsize", "ytick.labelsize"), 7),
    "axes.linewidth": 0.6,
    "legend.handlelength": 3.5,
    "figure.titlesize": 8,
    "pdf.fonttype": 42,  # text that can be searched and edited
    "svg.hashsalt": "inkloop",  # the same picture is the same file
}
_UNDATED: Mapping[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
Runs = Mapping[str, xr.Dataset]
SAMPLED = 1000
"""Cells along a side that are sampled for the scale of a large map."""
DRAWN = 1400
"""Cells along a side of a map that are drawn: more than its pixels."""


def save(figure: Figure, path: Path, formats: Sequence[str] = (PNG,)) -> list[Path]:
    """Write `path` with the suffix of each format, to a temporary name that is then put in place; the files."""
    name = path.stem if path.suffix.removeprefix(".") in FORMATS else path.name
    written = [path.with_name(f"{name}.{each}") for each in formats]
    with rc_context(STYLE):
        _lay_out(figure)
        for each, file in zip(formats, written, strict=True):
            with replaced(file) as partial:
                figure.savefig(partial, dpi=DPI, format=each, facecolor="white", metadata=_UNDATED.get(each))
    return written


def _lay_out(figure: Figure) -> None:
    """Give axes and texts their places, once: a figure with a layout engine, also "none", is drawn twice a format."""
    figure.set_dpi(DPI)
    if engine := figure.get_layout_engine():
        engine.execute(figure)
        figure.set_layout_engine(None)


def new_figure(height_in: float) -> Figure:
    """A figure as wide as a page."""
    return Figure(figsize=(WIDTH_IN, height_in), layout="constrained")


def outside_legend(
    figure: Figure | SubFigure, handles: Sequence[Artist], labels: Sequence[str], *, above: bool = False
) -> None:
    """A legend below the axes, or above them, in as few rows as fit into the width of the figure."""
    place: Literal["outside upper center", "outside lower center"]
    place = "outside upper center" if above else "outside lower center"
    for columns in range(max(1, len(labels)), 0, -1):
        legend = figure.legend(handles, labels, loc=place, ncols=columns, frameon=False)
        if columns == 1 or legend.get_window_extent().width <= figure.bbox.width:
            return
        legend.remove()


def draw_line(
    axes: Axes, number: int, x: Any, y: Any, label: str | None = None, *, ends: bool = True, **style: Any
) -> None:
    """The line of a run, with some hollow marks, and if it `ends` a full one at its end.

    The marks of several runs stand at different places, so that lines that coincide can be distinguished.
    """
    line = LINES[number % len(LINES)] | {"marker": MARKS[number % len(MARKS)], "markersize": 4.0} | style
    count = len(np.atleast_1d(x))
    step = max(1, math.ceil(count / MARKS_ON_A_LINE))
    places = range(number * step // len(MARKS), count - 1, step)
    axes.plot(x, y, label=label, markevery=list(places), markerfacecolor="white", markeredgewidth=0.9, **line)
    if count and ends:
        end = {"linestyle": "", "marker": line["marker"], "markersize": 5.0, "color": line["color"]}
        axes.plot(np.atleast_1d(x)[-1:], np.atleast_1d(y)[-1:], clip_on=False, zorder=3, **end)


def error_norm(errors: Sequence[FloatMap], least: float = 1e-3) -> Normalize:
    """One scale for the errors of several runs [um]: up to the largest, and fine enough for the smallest.

    least: smallest error that may have the darkest colour.
    """
    scales = [max(least, float(np.nanquantile(np.abs(thinned(error, SAMPLED)), 0.99))) for error in errors]
    limit = max(scales)
    smallest = max(min(scales), limit / FINEST)
    return Normalize(-limit, limit) if len(scales) == 1 else AsinhNorm(smallest / 2.0, -limit, limit)


def thinned(values: FloatMap, side: int) -> FloatMap:
    """Every n-th cell of a map, at most about `side` along each of its sides; a view."""
    step = max(1, math.ceil(max(values.shape) / side))
    return values[step // 2 :: step, step // 2 :: step]


def draw_error(
    axes: Axes,
    error: FloatMap,
    extent: tuple[float, float, float, float],
    norm: Normalize,
    colours: str = ERROR_COLOURS,
) -> AxesImage:
    """Draw a map of errors or differences [um], with dots where it is red, so that the sign is visible in grey
    print.
    """
    error = thinned(error, DRAWN)
    image = axes.imshow(
        error.T, origin="lower", extent=extent, interpolation="nearest", cmap=colours, norm=norm, aspect="equal"
    )
    (left, right, bottom, top), block = extent, math.ceil(max(error.shape) / DOTS)
    mean = block_means(error, block)
    colour = image.to_rgba(np.ma.masked_invalid(mean))[..., :3]
    i, j = np.nonzero(np.isfinite(mean) & (colour[..., 0] - colour[..., 2] > CLEARLY_RED))
    x = left + (i + 0.5) * block * (right - left) / error.shape[0]
    y = bottom + (j + 0.5) * block * (top - bottom) / error.shape[1]
    dots = np.where(colour[i, j].mean(axis=-1) < DARK, "white", "black")
    axes.scatter(x, y, s=0.6, c=dots.tolist(), marker="o", linewidths=0)
    axes.set(xlim=(left, right), ylim=(bottom, top))
    return image


def add_scale(
    figure: Figure | SubFigure,
    colours: ScalarMappable,
    label: str = "error [µm]",
    words: tuple[str, str] = (TOO_LOW, TOO_HIGH),
    **place: Any,
) -> None:
    """The scale of an error or a difference, with its decades; words: meaning of its upper and its lower end."""
    bar = figure.colorbar(colours, label=label, extend="both", format="{x:g}", **place)
    style: dict[str, Any] = {"xycoords": "axes fraction", "textcoords": "offset points", "ha": "center", "fontsize": 7}
    bar.ax.annotate(words[0], (0.5, 1.0), (0.0, 9.0), va="bottom", **style)
    bar.ax.annotate(words[1], (0.5, 0.0), (0.0, -9.0), va="top", **style)
    norm = colours.norm
    if isinstance(norm, AsinhNorm) and norm.vmax is not None:
        decades = 10.0 ** np.arange(math.ceil(math.log10(norm.linear_width)), math.floor(math.log10(norm.vmax)) + 1)
        end = round_below(norm.vmax)
        is_apart = decades.size == 0 or norm(end) - norm(decades[-1]) > NEXT_LABEL
        ticks = np.union1d(decades, end) if is_apart else decades
        bar.set_ticks([*-ticks[::-1], 0.0, *ticks], minor=False)
        bar.minorticks_off()


def round_below(value: float) -> float:
    """The largest 1, 2 or 5 of a decade that is not above a value."""
    decade = 10.0 ** math.floor(math.log10(value))
    return max(each * decade for each in (1.0, 2.0, 5.0) if each * decade <= value * (1.0 + 1e-9))


def extent_of(run: xr.Dataset) -> tuple[float, float, float, float]:
    """Edges of the grid [mm]: left, right, bottom, top."""
    half = float(run.attrs["pitch"]) / 2 * MM_PER_M
    x, y = run.x.values * MM_PER_M, run.y.values * MM_PER_M
    return float(x[0] - half), float(x[-1] + half), float(y[0] - half), float(y[-1] + half)


def middle_row(run: xr.Dataset) -> int:
    """Index along y of the middle of the part."""
    return int(np.flatnonzero(run.mask.any("x")).mean().round())


def figures_of(run: xr.Dataset) -> str:
    """Mean error and standard deviation of the last surface."""
    mean, std = (decimals(float(run[name][-1]) * UM_PER_M) for name in ("mean_error", "std"))
    return f"mean error {mean}, std {std} µm"
