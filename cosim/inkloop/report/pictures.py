"""The pictures of a run folder: those of a run, their files, and the report in a PDF for print."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path

import xarray as xr
from matplotlib import rc_context
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

from inkloop.files import replaced
from inkloop.report import plot
from inkloop.report.error_maps import comparison, error_map, hardware_against_model
from inkloop.report.layer_curves import cross_section, divergence, layers
from inkloop.report.model_difference import ModelDifference
from inkloop.report.solid_picture import materials, solids
from inkloop.report.surface_picture import surfaces
from inkloop.results.result import Result

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
