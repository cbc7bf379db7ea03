"""Published figures next to computed ones: a row each, in a terminal, a page and a spreadsheet; `inkloop reproduce`."""

from __future__ import annotations

import argparse
import csv
import importlib
import io
import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter

from matplotlib import rc_context
from matplotlib.figure import Figure
from rich.table import Table

from inkloop import __version__
from inkloop.errors import ResultError
from inkloop.files import write_text
from inkloop.printing.run import INTERRUPTED, new_run_folder
from inkloop.report import plot
from inkloop.report.terminal import Terminal
from inkloop_lab.reproduce import PAPERS

HEADINGS = ("where", "figure", "unit", "printed", "ours", "within", "reproduced")
"""`within`: largest difference of a figure that counts as reproduced."""


@dataclass(frozen=True)
class Row:
    """One figure of a paper.

    where: its table, figure or section; printed: None where the paper prints no number; ours, with the standard
    deviation over prints as `scatter`; within: largest difference of a reproduced figure, None if the two cannot be
    compared, for example printed on another plant; remark: reason of a difference, or method of reading.
    """

    where: str
    figure: str
    unit: str
    printed: float | None
    ours: float
    within: float | None = None
    remark: str = ""
    scatter: float | None = None

    @property
    def reproduced(self) -> str:
        """Whether the figure is reproduced; "-" if it cannot be compared."""
        if self.printed is None or self.within is None:
            return "-"
        if abs(self.ours - self.printed) <= self.within:
            return "yes"
        return "no, smaller" if abs(self.ours) < abs(self.printed) else "no, larger"

    @property
    def cells(self) -> tuple[str, ...]:
        """Its cells under `HEADINGS`."""
        ours = number(self.ours) if self.scatter is None else with_scatter(self.ours, self.scatter)
        return (
            self.where,
            self.figure,
            self.unit,
            "-" if self.printed is None else number(self.printed),
            ours,
            "-" if self.within is None or self.printed is None else number(self.within),
            self.reproduced,
        )


@dataclass(frozen=True)
class Part:
    """Result of one step of a reproduction."""

    rows: Sequence[Row] = ()
    pictures: Mapping[str, Figure] = field(default_factory=dict)


@dataclass(frozen=True)
class Step:
    """A step by its name; `find` takes whether to be quick: fewer prints, coarser grids."""

    name: str
    find: Callable[[bool], Part]


@dataclass(frozen=True)
class Paper:
    """A paper by its short name, its reference, and the steps that reproduce it."""

    name: str
    reference: str
    steps: Sequence[Step]


def number(value: float) -> str:
    """Four significant digits, as a person would write them; "-" for none."""
    if math.isnan(value):
        return "-"
    return f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:.4g}"


def with_scatter(mean: float, scatter: float) -> str:
    """A mean with as many decimals as two significant digits of its scatter have."""
    decimals = max(0, 1 - math.floor(math.log10(scatter))) if scatter > 0.0 else 3
    return f"{mean:.{decimals}f} ± {scatter:.{decimals}f}"


def terminal_table(title: str, rows: Sequence[Row]) -> Table:
    """All rows, a line under each place of the paper."""
    table = Table(title=title)
    for index, heading in enumerate(HEADINGS):
        table.add_column(heading, justify="right" if 2 < index < 6 else "left", overflow="fold")
    for index, row in enumerate(rows):
        shown = (row.where if index == 0 or rows[index - 1].where != row.where else "", *row.cells[1:])
        table.add_row(*shown, end_section=index + 1 == len(rows) or rows[index + 1].where != row.where)
    return table


def remarks(rows: Sequence[Row]) -> list[str]:
    """Remarks on rows, each once: first of those that are not reproduced."""
    noted = sorted((row for row in rows if row.remark), key=lambda row: not row.reproduced.startswith("no"))
    places: dict[str, dict[str, None]] = {}
    for row in noted:
        places.setdefault(row.remark, {})[re.split("[:,]", row.where)[0]] = None
    return [f"{', '.join(among)}: {remark}" for remark, among in places.items()]


def markdown(title: str, rows: Sequence[Row]) -> str:
    """The same table and remarks as a page."""
    lines = [f"# {title}", "", f"| {' | '.join(HEADINGS)} |", "|---|---|---|---:|---:|---:|---|"]
    lines += [f"| {' | '.join(row.cells)} |" for row in rows]
    lines += ["", *(f"- {remark}" for remark in remarks(rows))]
    return "\n".join(lines).rstrip() + "\n"


def spreadsheet(rows: Sequence[Row]) -> str:
    """The same rows as CSV, numbers in full."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow([*HEADINGS, "scatter", "remark"])
    for row in rows:
        numbers = ("" if value is None else value for value in (row.printed, row.ours, row.within))
        scatter = "" if row.scatter is None else row.scatter
        writer.writerow([row.where, row.figure, row.unit, *numbers, row.reproduced, scatter, row.remark])
    return text.getvalue()


def reproduce(options: argparse.Namespace, console: Terminal) -> int:
    """The exit code of the command; after Ctrl-C the folder holds the steps that are done. Raises ResultError."""
    paper: Paper = importlib.import_module(f"inkloop_lab.reproduce.{PAPERS[options.paper]}").PAPER
    folder = new_run_folder(options.out, paper.name)
    parts: dict[str, Part] = {}
    seconds: dict[str, float] = {}
    interrupted = False
    with console.progress() as progress:
        task = progress.add_task(paper.name, total=len(paper.steps))
        for step in paper.steps:
            progress.update(task, description=step.name)
            begin = perf_counter()
            try:
                with rc_context(plot.STYLE):
                    parts[step.name] = step.find(options.quick)
            except KeyboardInterrupt:
                interrupted = True
                break
            seconds[step.name] = perf_counter() - begin
            progress.advance(task)
            write(folder, paper, parts, {"quick": options.quick, "seconds": seconds}, options.pictures)
    rows = [row for part in parts.values() for row in part.rows]
    console.print(terminal_table(f"{paper.name}: printed and ours", rows))
    for remark in remarks(rows):
        console.sentence(f"- {remark}")
    done = "interrupted" if interrupted else "done"
    held = "what is finished is" if interrupted else "table, pages and pictures are"
    console.sentence(f"{done}: {held} in {folder}/")
    console.result(
        folder=folder, interrupted=interrupted, rows=[dict(zip(HEADINGS, row.cells, strict=True)) for row in rows]
    )
    return INTERRUPTED if interrupted else 0


def write(
    folder: Path, paper: Paper, parts: dict[str, Part], notes: dict[str, object], pictures: Sequence[str]
) -> None:
    """Write the table (.txt, .md, .csv), the pictures and their origin. Raises ResultError."""
    rows = [row for part in parts.values() for row in part.rows]
    text = io.StringIO()
    page = Terminal(text, width=140)
    page.print(terminal_table(f"{paper.name}: printed and ours", rows))
    for remark in remarks(rows):
        page.print(f"- {remark}")
    record = {"inkloop": __version__, "paper": paper.reference, "steps": list(parts), **notes}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_text(folder / "table.txt", text.getvalue())
        write_text(folder / "table.md", markdown(paper.reference, rows))
        write_text(folder / "table.csv", spreadsheet(rows))
        write_text(folder / "reproduce.json", json.dumps(record, indent=2) + "\n")
        for name, figure in list(parts.values())[-1].pictures.items():
            plot.save(figure, folder / name, pictures)
    except OSError as error:
        raise ResultError(f"{folder}: the tables cannot be written there: {error}") from error
