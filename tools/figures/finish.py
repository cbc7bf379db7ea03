"""Picture and table of "How a print ends" in the-layer-problem.md: `python tools/figures/finish.py` (`make gallery`).

The runs are kept in docs/explanation/finish.csv; `--drawn` takes them from there instead of printing again.
"""

from __future__ import annotations

import csv
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TypeAlias

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from inkloop.printing.run import print_part
from inkloop.report.plot import COLOURS, STYLE, WIDTH_IN, save
from inkloop.scenario.file import Scenario
from inkloop.units import UM_PER_M

ROOT = Path(__file__).parents[2]
HERE = ROOT / "docs" / "explanation"
PAGE = HERE / "the-layer-problem.md"
RUNS = HERE / "finish.csv"
SCENARIOS = {20: "cylinder.toml", 40: "cylinder-40.toml"}
SEEDS = range(1, 11)
ENDINGS: Mapping[str, Mapping[str, object]] = {
    '`finish = "even"`': {"finish": "even"},
    '`finish = "fast"`': {"finish": "fast"},
    "horizon 3, every layer": {"horizon": 3, "layer_worth": 0.0},
    "horizon 4, every layer": {"horizon": 4, "layer_worth": 0.0},
    "horizon 5, every layer": {"horizon": 5, "layer_worth": 0.0},
    "horizon 5, worth 0.0005": {"horizon": 5, "layer_worth": 0.0005},
    "horizon 5, worth 0.007": {"horizon": 5, "layer_worth": 0.007},
}
FIELDS = ("ending", "variation", "seed", "mae_um", "std_um", "layers")
ROWS = re.compile(r"(<!-- endings -->\n(?:\|.*\n){2})((?:\|.*\n)*)")


@dataclass(frozen=True)
class Run:
    """A print: how it ended, variation of the droplets [%], seed, errors over the part [um], layers."""

    ending: str
    variation: int
    seed: int
    mae_um: float
    std_um: float
    layers: int


Means: TypeAlias = dict[tuple[str, int], tuple[float, float, float]]
"""mae, std [um] and layers by ending and variation."""


def printed(ending: str, variation: int, seed: int) -> Run:
    """One print of the cylinder."""
    options = {f"components.controller.{name}": value for name, value in ENDINGS[ending].items()}
    metrics = print_part(Scenario.load(ROOT / "scenarios" / SCENARIOS[variation], {"seed": seed, **options})).metrics()
    errors = (round(float(metrics[name]) * UM_PER_M, 4) for name in ("mae", "std"))
    return Run(ending, variation, seed, *errors, layers=int(metrics["layers"]))


def kept(file: Path) -> list[Run]:
    """The runs of an earlier call."""
    with file.open(encoding="utf-8", newline="") as lines:
        return [
            Run(row["ending"], int(row["variation"]), int(row["seed"]), float(row["mae_um"]), float(row["std_um"]),
                int(row["layers"]))
            for row in csv.DictReader(lines)
        ]  # fmt: skip


def means(runs: Sequence[Run]) -> Means:
    """Means over the seeds."""
    groups = {(run.ending, run.variation) for run in runs}
    return {
        group: tuple(
            np.mean([(r.mae_um, r.std_um, r.layers) for r in runs if (r.ending, r.variation) == group], axis=0)
        )
        for group in groups
    }


def written(page: str, runs: Sequence[Run]) -> str:
    """The page with the rows of the table as the runs have them."""
    return ROWS.sub(lambda found: found[1] + "".join(rows(means(runs))), page)


def rows(mean: Means) -> Iterator[str]:
    """mae, std and layers of each ending, at both variations."""
    for ending in ENDINGS:
        cells = [f"{m:.2f} | {s:.2f} | {n:.0f}" for m, s, n in (mean[ending, variation] for variation in SCENARIOS)]
        yield f"| {ending} | {' | '.join(cells)} |\n"


def trade_off(runs: Sequence[Run]) -> Figure:
    """Layers against standard deviation, each ending one point."""
    figure = Figure(figsize=(WIDTH_IN, 2.8), layout="constrained")
    mean = means(runs)
    for axes, variation in zip(figure.subplots(1, len(SCENARIOS)), SCENARIOS, strict=True):
        for number, ending in enumerate(ENDINGS):
            _, std, layers = mean[ending, variation]
            label = ending.strip("`") if variation == next(iter(SCENARIOS)) else None
            axes.plot(layers, std, "os^vDPX"[number], color=COLOURS[number % len(COLOURS)], label=label)
        axes.set(xlabel="layers printed", ylabel="standard deviation [µm]", title=f"{variation} % of a droplet missing")
        axes.grid(color="0.92")
    figure.legend(loc="outside lower center", ncols=3)
    return figure


if __name__ == "__main__":
    if "--drawn" not in sys.argv:
        with ProcessPoolExecutor() as pool:
            runs = list(pool.map(printed, *zip(*product(ENDINGS, SCENARIOS, SEEDS), strict=True)))
        with RUNS.open("w", encoding="utf-8", newline="") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerows([FIELDS, *(vars(run).values() for run in runs)])
    runs = kept(RUNS)
    PAGE.write_text(written(PAGE.read_text(encoding="utf-8"), runs), encoding="utf-8")
    with rc_context(STYLE):
        save(trade_off(runs), HERE / "finish.png")
