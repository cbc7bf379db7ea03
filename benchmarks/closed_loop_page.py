"""Table "What it reaches" in closing-the-loop.md: `python -m benchmarks.closed_loop_page`, also run by `make gallery`.

The prints of `python -m benchmarks closed_loop` are kept in docs/explanation/closed-loop.csv; `--drawn` takes them from
there instead of printing again.
"""

from __future__ import annotations

import csv
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from math import isnan
from pathlib import Path

from rich.console import Console

from benchmarks import closed_loop
from benchmarks.prints import OURS, SHOWN, Metrics, printed
from benchmarks.target_table import Figure, table

ROOT = Path(__file__).parents[1]
HERE = ROOT / "docs" / "explanation"
PAGE = HERE / "closing-the-loop.md"
RUNS = HERE / "closed-loop.csv"
SEEDS = 10
COLUMNS = {
    "mean_error_um": "mean_error", "mae_um": "mae", "std_um": "std", "rms_um": "rms", "highest_um": "highest",
    "layers": "layers", "shift_error_cells": "shift_error", "untrusted_cells": "untrusted",
}  # fmt: skip
"""Metrics of a print, by the name of their column in the file."""
ON_PAGE = ("mae", "std", "rms", "highest", "layers", "shift_error")
ROWS = re.compile(r"(<!-- closed loop -->\n(?:\|.*\n){2})((?:\|.*\n)*)")
TOO_HIGH = re.compile(r"(<!-- too high -->)\d+ of \d+ prints")


def keep(metrics: Metrics, file: Path) -> None:
    """Write a line for each print."""
    with file.open("w", encoding="utf-8", newline="") as lines:
        rows = csv.writer(lines, lineterminator="\n")
        rows.writerow(["case", "controller", "seed", *COLUMNS])
        for (case, planner), prints in metrics.items():
            for number, found in enumerate(prints, start=1):
                values = [f"{found[metric] * SHOWN[metric][1]:.4g}" for metric in COLUMNS.values()]
                rows.writerow([case, planner, number, *values])


def kept(file: Path) -> Metrics:
    """The prints of an earlier call."""
    metrics: Metrics = {}
    with file.open(encoding="utf-8", newline="") as lines:
        for row in csv.DictReader(lines):
            found = {metric: float(row[name]) / SHOWN[metric][1] for name, metric in COLUMNS.items()}
            metrics.setdefault((row["case"], row["controller"]), []).append(found)
    return metrics


def written(page: str, metrics: Metrics) -> str:
    """The page with the rows of its table as the prints have them."""
    found = closed_loop.rows(metrics)
    *_, (silent,) = found.values()
    count = sum(len(metrics[case.name, OURS]) for case in closed_loop.CASES)
    page = TOO_HIGH.sub(lambda marked: f"{marked[1]}{silent.now:.0f} of {count} prints", page)
    return ROWS.sub(lambda marked: marked[1] + "".join(lines(found)), page)


def lines(found: Mapping[str, Sequence[Figure]]) -> Iterator[str]:
    """A line for each case: the figure, what must be and what is aimed at."""
    for case in closed_loop.CASES:
        figures = {wanted.metric: figure for wanted, figure in zip(case.wanted, found[case.name], strict=True)}
        cells = [cell(figures[metric]) if metric in figures else "" for metric in ON_PAGE]
        yield f"| {case.name.replace(' um', ' µm')} | {' | '.join(cells)} |\n"


def cell(figure: Figure) -> str:
    """Now / must / aim; bold if it must be better."""
    now = f"{figure.now:.3f}" if figure.now < 0.01 else f"{figure.now:.3g}"
    limits = [f"{limit:.3g}" for limit in (figure.must, figure.aim) if not isnan(limit)]
    return " / ".join([f"**{now}**" if figure.reached.startswith("MISSED") else now, *limits])


if __name__ == "__main__":
    if "--drawn" not in sys.argv:
        keep(printed(closed_loop.CASES, SEEDS), RUNS)
    metrics = kept(RUNS)
    PAGE.write_text(written(PAGE.read_text(encoding="utf-8"), metrics), encoding="utf-8")
    Console(width=140).print(table("whole prints in closed loop", closed_loop.rows(metrics)))
