"""Whole prints: our controller, the paper's search and printing blindly, on the same plant with the same droplets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
from rich.progress import track
from rich.table import Table

from benchmarks.target_table import Figure, table
from inkloop.printing.run import print_part
from inkloop.scenario.file import Scenario
from inkloop.units import UM_PER_M

SCENARIOS = Path(__file__).parents[1] / "scenarios"
OPEN_LOOP = "open loop"  # the comparison run of that name in the scenario
FULL_LAYER_UM = 7.6  # a print that ends further off its height has run away (assumed)
SHOWN = {
    "mean_error": ("mean error, um", UM_PER_M),
    "mean_height": ("average height, um", UM_PER_M),
    "mae": ("mean absolute error, um", UM_PER_M),
    "std": ("standard deviation, um", UM_PER_M),
    "mismatch": ("geometry mismatch, %", 100.0),
}
"""Name and scale of each metric in the table."""


@dataclass(frozen=True)
class Wanted:
    """Target of one metric, as in `Figure`."""

    metric: str
    must: float = nan
    aim: float = nan
    wanted: float | None = None
    printed: str = "-"


@dataclass(frozen=True)
class Case:
    """A scenario with overrides, printed with several seeds, and what is wanted of it.

    open_loop: it has a comparison run of that name.
    """

    name: str
    scenario: str
    seeds: range
    wanted: tuple[Wanted, ...]
    overrides: Mapping[str, Any] = field(default_factory=dict)
    open_loop: bool = True


def height_and_evenness(must: tuple[float, float], aim: tuple[float, float], bias: str, std: str) -> tuple[Wanted, ...]:
    """Mean absolute error and standard deviation to reach [um], and what the paper prints."""
    return (
        Wanted("mean_error", printed=bias),
        Wanted("mae", must[0], aim[0]),
        Wanted("std", must[1], aim[1], printed=std),
    )


TEN, THREE, TWO = range(1, 11), range(1, 4), range(1, 3)
NOISY_40 = {"components.printer.variation": 0.4}
CASES = (
    Case("cylinder, 20 %", "cylinder", TEN, height_and_evenness((0.45, 0.60), (0.38, 0.50), "0.7", "4.1")),
    Case("cylinder, 40 %", "cylinder-40", TEN, height_and_evenness((0.60, 0.76), (0.57, 0.72), "1.9", "4.5")),
    Case("20 %, sensor 1 um + 0.1 um, ink unknown", "noisy-sensor", TEN,
         height_and_evenness((0.50, 0.65), (0.48, 0.62), "-", "-"), open_loop=False),
    Case("40 %, the same sensor", "noisy-sensor", TEN,
         height_and_evenness((0.66, 0.85), (0.62, 0.80), "-", "-"), NOISY_40, open_loop=False),
    Case("cuboid 8 x 8, 22.8 um, 20 %", "cuboid", TEN,
         (Wanted("mean_height", 0.2, wanted=22.8, printed="22.3"), Wanted("std", 0.6, 0.45, printed="4.4"))),
    Case("pipe junction 100 x 100, two inks, 20 %", "pipe-junction", TWO,
         (Wanted("mismatch", 4.0, 3.6), Wanted("mae", 0.8, 0.5))),
)  # fmt: skip
NO_RUNAWAY = (Wanted("mean_error", FULL_LAYER_UM, wanted=0.0), Wanted("std"))
ALPHAS = tuple(
    Case(
        f"cylinder, 20 %, alpha {alpha}",
        "cylinder",
        THREE,
        NO_RUNAWAY,
        {"components.controller.alpha": alpha},
        False,
    )
    for alpha in (1.0, 0.8, 0.5, 0.3, 0.2, 0.1)
)
"""From the most weight on height down: with less of it the part is to end more even."""


def measure() -> Table:
    """Errors of the last surface over the part, mean and scatter over seeds, and their targets."""
    prints = [
        (case, planner, seed)
        for case in (*CASES, *ALPHAS)
        for planner in ("LayerMpc", "StochasticGreedy", *([OPEN_LOOP] if case.open_loop else []))
        for seed in case.seeds
    ]
    metrics: dict[tuple[str, str], list[Mapping[str, float]]] = {}
    with ProcessPoolExecutor() as pool:
        printed = pool.map(_printed, prints)
        for (case, planner, _), figures in zip(
            prints, track(printed, "prints", len(prints), transient=True), strict=True
        ):
            metrics.setdefault((case.name, planner), []).append(figures)
    rows = {case.name: [_figure(case, wanted, metrics) for wanted in case.wanted] for case in (*CASES, *ALPHAS)}
    for more, less in pairwise(ALPHAS):
        bias, std = rows[less.name]
        rows[less.name] = [bias, replace(std, aim=float(np.mean(rows[more.name][1].ours)))]
    return table("whole prints; 20 %: up to this share of each droplet is missing", rows)


def _printed(run: tuple[Case, str, int]) -> dict[str, float]:
    """Metrics of one print [m], with the average height of the part."""
    case, planner, seed = run
    chosen = {} if planner == OPEN_LOOP else {"components.controller.kind": planner}
    scenario = Scenario.load(SCENARIOS / f"{case.scenario}.toml", {"seed": seed, **case.overrides, **chosen})
    result = print_part(scenario.variant(OPEN_LOOP) if planner == OPEN_LOOP else scenario)
    height, part = result.final_height.values, result.dataset.mask.values
    return {**result.metrics(), "mean_height": float(height[part].mean())}


def _figure(case: Case, wanted: Wanted, metrics: Mapping[tuple[str, str], Sequence[Mapping[str, float]]]) -> Figure:
    name, scale = SHOWN[wanted.metric]
    ours, papers, open_loop = (
        [figures[wanted.metric] * scale for figures in metrics.get((case.name, planner), [])]
        for planner in ("LayerMpc", "StochasticGreedy", OPEN_LOOP)
    )
    return Figure(name, ours, wanted.must, wanted.aim, wanted.wanted, papers, open_loop, wanted.printed)
