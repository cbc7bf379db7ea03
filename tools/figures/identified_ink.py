"""Tables and picture of identify-an-ink.md."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from rich.table import Table
from tools.figures.pages import DOCS, Texts, read_json, table, write_json

from inkloop.identify import designs
from inkloop.identify.command import tables
from inkloop.identify.experiments import Plan, perform, plant_scenario
from inkloop.identify.identification import identify
from inkloop.identify.ink_regression import identify_ink
from inkloop.identify.picture import save
from inkloop.identify.print_record import PrintRecord
from inkloop.models import DropletVolumes, LayerDeposition
from inkloop.report.formats import PNG
from inkloop.units import UM_PER_M

HERE = DOCS / "how-to"
PAGE = HERE / "identify-an-ink.md"
RECORD = PAGE.with_suffix(".json")
PITCH = 263.256e-6
PRINTS = 20


def print_of(patterns: list[NDArray[np.int32]], noise: float, seed: int, variation: float = 0.0) -> PrintRecord:
    """Layers of the ink of Lu et al. as a profiler with white noise [m] sees them."""
    model = LayerDeposition()
    surfaces = [model.start(np.zeros(patterns[0].shape))]
    for number, pattern in enumerate(patterns, start=1):
        nx, ny = pattern.shape
        volume = DropletVolumes(variation, seed=seed).of_layer(nx, ny, number)
        surfaces.append(model.layer(surfaces[-1], pattern, number, volume))
    scans = np.stack([surface.height for surface in surfaces])
    return PrintRecord(
        "made up", PITCH, np.stack(patterns), scans + np.random.default_rng(seed).normal(0, noise, scans.shape)
    )


def bias() -> Iterator[list[str]]:
    """What noise does to a plain regression and to ours, over prints that differ in noise and patterns."""
    cases = [("one layer, 20 x 20 cells", 20, 1, 0.3e-6), ("5 layers, 40 x 40 cells", 40, 5, 1e-6)]
    for label, side, count, noise in cases:
        records = [print_of(designs.layers(side, side, count, seed, margin=1), noise, seed) for seed in range(PRINTS)]
        for method, correct in (("plain", False), ("this page", True)):
            found = np.array([identify_ink([one], noise, correct=correct).heights[0] for one in records])
            error = (found / LayerDeposition().heights[0] - 1.0) * 100
            means, worst = error.mean(axis=0), np.abs(error).max(axis=0)
            figures = (f"{m:+.1f} ({w:.1f}) %" for m, w in zip(means, worst, strict=True))
            yield [label, f"{noise * UM_PER_M:g} um", method, *figures]


def coverage() -> str:
    """In how many prints the 95 % intervals hold the mean ink, with droplets that lack up to 20 % of their volume."""
    true = 0.9 * np.array(LayerDeposition().heights[0])
    inside = []
    for seed in range(2 * PRINTS):
        record = print_of(designs.layers(24, 24, 4, seed, margin=0), 0.5e-6, seed, variation=0.2)
        found = identify_ink([record], 0.5e-6)
        inside.append(np.abs(found.heights[0] - true) <= found.half_widths[0])
    return f"{100 * np.mean(inside):.0f} %"


def shown(found: Table) -> list[list[str]]:
    """Heads and rows of a table of the screen."""
    columns = [[str(column.header).replace("\\[", "["), *map(str, column.cells)] for column in found.columns]
    return [list(line) for line in zip(*columns, strict=True)]


def run() -> None:
    """Keep the tables and draw the picture."""
    found = identify(perform(plant_scenario("YoungLaplaceDeposition", 0.1, {"grid.pitch_um": 42.3}), Plan()))
    first, *_, last = (shown(one) for one in tables(found))
    first[0][1:] = [f"{height} [um]" for height in first[0][1:]]
    save(found, HERE / "identified-ink.png", [PNG])
    noise = [["print", "noise", "method", "h1", "h2", "h3"], *bias()]
    write_json(RECORD, {"noise": noise, "coverage": coverage(), "heights": first, "models": last})


def texts() -> Texts:
    """The tables, and the share of the intervals that hold."""
    record = read_json(RECORD)
    marked = {name: table(*_parts(record[name])) for name in ("noise", "heights", "models")}
    return {PAGE: {**marked, "coverage": record["coverage"]}}


def _parts(lines: Sequence[Sequence[str]]) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
    return lines[0], lines[1:]
