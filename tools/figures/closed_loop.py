"""Table of closing-the-loop.md: the prints of `python -m benchmarks closed_loop`, each kept in a record."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from math import isnan
from pathlib import Path

import numpy as np
from benchmarks import closed_loop
from benchmarks.prints import FLIPS, OPEN_LOOP, OURS, PAPERS, SHOWN, Figure, Metrics, column, printed
from tools.figures.pages import DOCS, ROOT, Texts, table

from inkloop.files import replaced

HERE = DOCS / "explanation"
PAGE = HERE / "closing-the-loop.md"
RUNS = HERE / "closed-loop.csv"
SEEDS = 10
COLUMNS = {
    "mean_error_um": "mean_error", "mae_um": "mae", "std_um": "std", "rms_um": "rms", "highest_um": "highest",
    "layers": "layers", "shift_error_cells": "shift_error", "untrusted_layers": "untrusted",
}  # fmt: skip
"""Metrics of a print, by the name of their column in the file."""
README = ROOT / "README.md"
ROWS = {
    OURS: "inkloop, five layers ahead",
    FLIPS: FLIPS,
    PAPERS: "the paper's search, one layer ahead, nominal ink",
    OPEN_LOOP: "open loop, 53 full layers",
}
"""Planner -> its row of README."""
README_HEADS = ("same plant, same droplets", "distance of the mean", "mean absolute error", "standard deviation")
ON_PAGE = ("mae", "std", "rms", "highest", "layers", "shift_error")
CASES_ON_PAGE = (
    "cylinder, 20 %", "cylinder, 40 %", "20 %, sensor 1 um + 0.1 um, ink unknown", "R10, sensor in register",
    "R10, shift 0.25 cells in x and y", "R10, shift 1.0 cells in x and y", "R10, spot 1 cell",
    "R10, shift 0.25, spot 0.5 cells, noise 1 um, 10 % drop-out", "Young-Laplace, score board",
)  # fmt: skip
"""Cases of the table, beside those that must be better; the record has all."""
HEADS = ("case", "mean absolute error", "std", "rms", "highest", "layers", "shift")


def keep(metrics: Metrics, file: Path) -> None:
    """Write a line for each print."""
    with replaced(file) as partial, partial.open("w", encoding="utf-8", newline="") as lines:
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


def run() -> None:
    """All prints of the benchmark."""
    keep(printed(closed_loop.CASES, SEEDS), RUNS)


def texts() -> Texts:
    """The table, and how many prints ran away unnoticed."""
    metrics = kept(RUNS)
    return {PAGE: texts_of(metrics), README: {"cylinder": table(README_HEADS, readme_rows(metrics))}}


def readme_rows(metrics: Metrics) -> Iterator[list[str]]:
    """A line for each planner on the first cylinder: means over the seeds, of mean errors those of absolute values."""
    case = closed_loop.CYLINDERS[0]
    for planner, words in ROWS.items():
        figures = (np.mean(column(metrics, case, planner, metric)) for metric in ("mean_error", "mae", "std"))
        yield [words, *(f"{figure:.2f}" for figure in figures)]


def texts_of(metrics: Metrics) -> dict[str, str]:
    """The same of these prints."""
    found = closed_loop.rows(metrics)
    *_, (silent,) = found.values()
    count = sum(len(metrics[case.name, OURS]) for case in closed_loop.CASES)
    return {"closed loop": table(HEADS, lines(found)), "too high": f"{silent.now:.0f} of {count} prints"}


def lines(found: Mapping[str, Sequence[Figure]]) -> Iterator[list[str]]:
    """A line for each case of the page: the figure and what must be."""
    for case in closed_loop.CASES:
        figures = {wanted.metric: figure for wanted, figure in zip(case.wanted, found[case.name], strict=True)}
        cells = [cell(figures[metric]) if metric in figures else "" for metric in ON_PAGE]
        if case.name in CASES_ON_PAGE or any(each.startswith("**") for each in cells):
            yield [case.name.replace(" um", " µm"), *cells]


def cell(figure: Figure) -> str:
    """Now / must; bold if it must be better."""
    now = f"{figure.now:.3f}" if figure.now < 0.01 else f"{figure.now:.3g}"
    shown = f"**{now}**" if figure.reached.startswith("MISSED") else now
    return shown if isnan(figure.must) else f"{shown} / {figure.must:.3g}"
