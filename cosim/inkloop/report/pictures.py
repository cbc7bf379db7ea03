"""The pictures of a run folder: those of a run, their files, and the report in a PDF for print."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib import rc_context
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from inkloop.files import replaced
from inkloop.report import plot
from inkloop.report.layer_curves import cross_section, divergence, draw_layers, layers
from inkloop.report.model_difference import SIGN, ModelDifference
from inkloop.report.plot import (
    COLOURS,
    DOTTED,
    ERROR_LABEL,
    WIDTH_IN,
    Runs,
    add_scale,
    draw_error,
    draw_line,
    error_norm,
    extent_of,
    figures_of,
    new_figure,
    outside_legend,
)
from inkloop.report.solid_picture import materials, solids
from inkloop.report.surface_picture import surfaces
from inkloop.results.metrics import TOO_HIGH, TOO_LOW, error_of
from inkloop.results.result import Result
from inkloop.units import UM_PER_M

PDF_FILE = "report.pdf"
PAGE_IN = (8.27, 11.69)
"""A4."""
LINES, COLUMNS = 88, 120
"""Lines and columns of a page of text."""


def draw(folder: Path, runs: Mapping[str, Result], difference: ModelDifference | None, formats: Sequence[str]) -> None:
    """Write the pictures of a run, the first of `runs`, and of its comparison runs into `folder`, in each format.

    difference: of a run on devices, its surfaces less those of the model.
    """
    with rc_context(plot.STYLE):
        figures = pictures(runs)
        if difference:
            name, run = next(iter(_labelled(runs).items()))
            figures["hardware-against-model"] = hardware_against_model(run, difference, name)
        for name, figure in figures.items():
            plot.save(figure, folder / name, formats)


def draw_comparison(runs: Mapping[str, Result], picture: Path, formats: Sequence[str]) -> list[Path]:
    """Write one picture of several runs of one grid, `picture` with the suffix of each format; the files."""
    with rc_context(plot.STYLE):
        return plot.save(comparison(_labelled(runs)), picture, formats)


def pictures(runs: Mapping[str, Result]) -> dict[str, Figure]:
    """File name -> figure."""
    labelled = _labelled(runs)
    name, main = next(iter(labelled.items()))
    figures = {
        "surface": surfaces({name: main}),
        "cross-section": cross_section(labelled),
        "error-map": error_map(main, name),
        "layers": layers(labelled),
    }
    if len(labelled) > 1:
        figures["open-against-closed"] = surfaces(labelled)
    if "growth_divergence" in main:
        figures["divergence"] = divergence(labelled)
    if {"ink", "region_bottom"} <= main.keys():
        figures["materials"] = materials(main, name)
        figures["solid"] = solids(labelled)
    return figures


def _labelled(runs: Mapping[str, Result]) -> dict[str, xr.Dataset]:
    """The data of each run by its label; a dollar sign in it does not begin a formula."""
    return {name.replace("$", r"\$"): result.dataset for name, result in runs.items()}


def write_pdf(path: Path, runs: Mapping[str, Result], summary: str) -> None:
    """Write table, pictures and scenario of runs by name, the run itself first. Raises OSError.

    summary: the text of `summary.txt`.
    """
    main = next(iter(runs.values()))
    with rc_context(plot.STYLE), replaced(path) as partial, PdfPages(partial, metadata={"CreationDate": None}) as pages:
        for figure in (*_text(summary), *pictures(runs).values(), *_text(main.scenario_text)):
            pages.savefig(figure)


def _text(text: str) -> Iterator[Figure]:
    """Pages of a text; long lines are continued below. No letter of it is markup."""
    wrapped = (textwrap.wrap(line, COLUMNS, drop_whitespace=False) or [""] for line in text.splitlines())
    lines = list(chain.from_iterable(wrapped))
    for first in range(0, len(lines), LINES):
        figure = Figure(figsize=PAGE_IN)
        shown = "\n".join(lines[first : first + LINES])
        figure.text(0.07, 0.96, shown, family="monospace", fontsize=7, va="top", parse_math=False)
        yield figure


MAP_IN = 2.3  # height of a map
SCALE_IN = 1.3  # share of its width for ticks, labels and the colour scale
MAPS = 4
"""Number of layers of hardware against model that are shown, the last one included."""


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
