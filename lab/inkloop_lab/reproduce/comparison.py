"""Published figures next to computed ones: one row each, in a terminal, a page and a spreadsheet."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from matplotlib.figure import Figure
from rich.table import Table

HEADINGS = ("where", "figure", "unit", "printed", "ours", "reproduced")


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
        table.add_column(heading, justify="right" if 2 < index < 5 else "left", overflow="fold")
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
    lines = [f"# {title}", "", f"| {' | '.join(HEADINGS)} |", "|---|---|---|---:|---:|---|"]
    lines += [f"| {' | '.join(row.cells)} |" for row in rows]
    lines += ["", *(f"- {remark}" for remark in remarks(rows))]
    return "\n".join(lines).rstrip() + "\n"


def spreadsheet(rows: Sequence[Row]) -> str:
    """The same rows as CSV, numbers in full."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow([*HEADINGS, "scatter", "remark"])
    for row in rows:
        printed, scatter = ("" if value is None else value for value in (row.printed, row.scatter))
        writer.writerow([row.where, row.figure, row.unit, printed, row.ours, row.reproduced, scatter, row.remark])
    return text.getvalue()
