"""Table of closing-the-loop.md: prints of `python -m benchmarks lying_scans`, each kept in a record."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import isnan
from pathlib import Path

from benchmarks.lying_scans import PROCESSES
from tools.figures.pages import DOCS, Texts, table

from inkloop.files import replaced
from support.lying_scans.cases import CASES
from support.lying_scans.rig import STOPPED, Outcome, print_cases

PAGE = DOCS / "explanation" / "closing-the-loop.md"
PRINTS = DOCS / "explanation" / "lying-scans.csv"
SEEDS = 3
COLUMNS = ("mae", "highest", "lowest", "layers", "ending", "untrusted_from")
HEADS = ("scan or plant", "mean absolute error", "highest", "ends")
ON_PAGE = (
    "in register, 20 %", "spot 1 cell", "shift 1, 0", "rotation 0.5 degrees", "magnification 3 %",
    "levelled anew: offset and tilt 3 um", "realistic, displaced, spikes, drop-outs, every third missing",
    "wall of 1 cell along y, noise 0.5, shift 0.25", "satellites 1 %", "volume falls by 30 %", "no flow",
    "droplets land 0.2, -0.1 cells off", "shrinks as a whole, 0.97", "head dry from layer 10", "scans mirrored in x",
    "scans one layer late", "volume 0.45 of nominal",
)  # fmt: skip
"""Cases of the table; the record has all."""

Prints = Mapping[str, Sequence[Mapping[str, str]]]
"""Columns of the prints of each case, in the order of their seeds."""


def keep(outcomes: Iterable[Outcome], file: Path) -> None:
    """Write a line for each print; heights against the target in um."""
    with replaced(file) as partial, partial.open("w", encoding="utf-8", newline="") as lines:
        rows = csv.writer(lines, lineterminator="\n")
        rows.writerow(["case", "seed", *COLUMNS])
        for each in outcomes:
            figures = [f"{value:.4g}" for value in (each.mae, each.highest, each.lowest)]
            untrusted = "" if each.untrusted_from is None else each.untrusted_from
            rows.writerow([each.case, each.seed, *figures, each.layers, each.ending, untrusted])


def kept(file: Path) -> Prints:
    """The prints of an earlier call."""
    found: dict[str, list[Mapping[str, str]]] = {}
    with file.open(encoding="utf-8", newline="") as lines:
        for row in csv.DictReader(lines):
            found.setdefault(row["case"], []).append(row)
    return found


def run() -> None:
    """All prints of the benchmark."""
    keep(print_cases(CASES.values(), SEEDS, PROCESSES), PRINTS)


def texts() -> Texts:
    """The table of some cases."""
    return {PAGE: {"lying scans": table(HEADS, lines(kept(PRINTS)))}}


def lines(prints: Prints) -> Iterator[list[str]]:
    """A line for each case: the mean over its seeds, the worst seed, and how they end."""
    for name in ON_PAGE:
        case, of_case = CASES[name], prints[name]
        mae = sum(float(each["mae"]) for each in of_case) / len(of_case)
        highest = max(float(each["highest"]) for each in of_case)
        figures = (f"{mae:.2f}{limit(case.must.mae)}", f"{highest:.1f}{limit(case.must.highest)}")
        yield [name.replace(" um", " µm"), *figures, ending(of_case)]


def limit(must: float) -> str:
    """What must be, behind a figure."""
    return "" if isnan(must) else f" / {must:g}"


def ending(prints: Sequence[Mapping[str, str]]) -> str:
    """How the prints of a case end, and from which layer on they are not trusted."""
    stopped = sorted({each["layers"] for each in prints if each["ending"] == STOPPED}, key=int)
    warned = [int(each["untrusted_from"]) for each in prints if each["untrusted_from"]]
    if stopped:
        return f"stopped at layer {' to '.join(dict.fromkeys((stopped[0], stopped[-1])))}"
    return f"{len(warned)} of {len(prints)} untrusted from layer {min(warned)} on" if warned else "done"
