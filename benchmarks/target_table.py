"""One row for each figure that the controller is to reach, and how far it got."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isnan, nan

import numpy as np
from rich.table import Table

HEADINGS = ("case", "figure", "ours", "scatter", "open loop", "printed", "must", "aim", "reached")


@dataclass(frozen=True)
class Figure:
    """A figure of a case, measured on one or more seeds; the mean counts, or the largest.

    ours, open_loop: of our controller and of blind printing on the same plant (empty: it does not apply); printed: by
    the paper, on another plant; must, aim: the largest that will do (NaN: nothing is asked); worst: the largest of the
    seeds counts.
    """

    name: str
    ours: Sequence[float]
    must: float = nan
    aim: float = nan
    open_loop: Sequence[float] = ()
    printed: str = "-"
    worst: bool = False

    @property
    def now(self) -> float:
        """The figure of our controller that is compared."""
        return float(np.max(self.ours) if self.worst else np.mean(self.ours))

    @property
    def reached(self) -> str:
        """Whether the aim, or what must be, is reached, or by how much it is missed; "-" where nothing is asked."""
        if isnan(self.must) and isnan(self.aim):
            return "-"
        if self.now <= self.aim:
            return "aim"
        if isnan(self.must):
            return "not the aim"
        if self.now <= self.must:
            return "must"
        return f"MISSED: {self.now / self.must:.2f} x" if self.must else "MISSED"

    def row(self) -> tuple[str, ...]:
        """Its cells in the table, after the case."""
        sample = len(self.ours)
        scatter = f"{np.std(self.ours, ddof=1):.2g}" if sample > 1 else "-"
        others = (self._text(self.open_loop), self.printed)
        limits = ("-" if isnan(limit) else f"{limit:.3g}" for limit in (self.must, self.aim))
        return (self.name, self._text(self.ours), scatter, *others, *limits, self.reached)

    def _text(self, values: Sequence[float]) -> str:
        if not len(values):
            return "-"
        counts = float(np.max(values) if self.worst else np.mean(values))
        return f"{counts:.4g}" if abs(counts) >= 10.0 else f"{counts:.3g}"


def table(title: str, cases: Mapping[str, Sequence[Figure]]) -> Table:
    """The figures of all cases, without empty columns; "scatter" is the standard deviation over seeds."""
    rows = [
        ("" if number else case, *figure.row())
        for case, figures in cases.items()
        for number, figure in enumerate(figures)
    ]
    used = [index for index in range(len(HEADINGS)) if any(row[index] not in ("", "-") for row in rows)]
    shown = Table(title=title)
    for index in used:
        shown.add_column(HEADINGS[index], justify="left" if index < 2 else "right", no_wrap=index > 1)
    for number, row in enumerate(rows):
        last = number + 1 == len(rows) or rows[number + 1][0] != ""
        shown.add_row(*(row[index] for index in used), end_section=last)
    return shown
