"""Our controller, the paper's search and printing blindly, on the same plant and the same droplets."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.progress import track
from rich.table import Table

from benchmarks.timing import scaled
from inkloop.result import Result
from inkloop.run import print_part
from inkloop.scenario import Scenario

SCENARIOS = Path(__file__).parents[1] / "scenarios"
SEEDS = range(1, 11)
HEADINGS = ("variation", "controller", "mean error", "mae", "std", "layers", "wall per print", "solve per layer")


def measure() -> Table:
    """Final errors over the part of the cylinder, mean of ten seeds, and time per print and layer."""
    table = Table(title=f"cylinder of 709 cells, 400 um, mean of {len(SEEDS)} seeds (um)")
    for heading in (
        "variation",
        "controller",
        "mean error",
        "mae",
        "std",
        "layers",
        "wall per print",
        "solve per layer",
    ):
        table.add_column(heading, justify="right")
    for name, variation in (("cylinder", "20 %"), ("cylinder-40", "40 %")):
        runs: dict[str, list[Result]] = {}
        for seed in track(SEEDS, description=variation, transient=True):
            scenario = Scenario.load(SCENARIOS / f"{name}.toml", [f"seed={seed}"])
            variants = {scenario.tables.label: scenario} | {
                key: scenario.variant(key) for key in scenario.tables.compare
            }
            for label, variant in variants.items():
                runs.setdefault(label, []).append(print_part(variant))
        for label, results in runs.items():
            table.add_row(variation, label, *_figures(results))
    return table


def _figures(results: list[Result]) -> tuple[str, ...]:
    metrics = [result.metrics() for result in results]
    errors = [f"{np.mean([figures[key] for figures in metrics]) * 1e6:.2f}" for key in ("mean_error", "mae", "std")]
    layers = f"{np.mean([figures['layers'] for figures in metrics]):.0f}"
    solve = np.mean([float(result.dataset.solve_time[1:].mean()) for result in results])
    return *errors, layers, scaled(float(np.mean([result.wall_s for result in results]))), scaled(float(solve))
