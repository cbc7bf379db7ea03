"""The report of a run as a PDF for print: the table and remarks, its pictures, the scenario."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from itertools import chain
from pathlib import Path

from matplotlib import rc_context
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

from inkloop.files import replaced
from inkloop.report import plot
from inkloop.report.pictures import pictures
from inkloop.results.result import Result

FILE = "report.pdf"
PAGE_IN = (8.27, 11.69)
"""A4."""
LINES, COLUMNS = 88, 120
"""Lines and columns of a page of text."""


def write(path: Path, runs: Mapping[str, Result], summary: str) -> None:
    """Write runs by name, the run itself first; summary: the text of `summary.txt`. Raises OSError."""
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
