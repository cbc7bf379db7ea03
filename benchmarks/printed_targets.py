"""Whole prints: our controller, the paper's search and printing blindly, on the same plant with the same droplets."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from rich.table import Table

from benchmarks.closed_loop import CYLINDERS
from benchmarks.prints import OPEN_LOOP, OURS, PAPERS, SCENARIOS, Case, Wanted, figures, printed
from benchmarks.target_table import table

FULL_LAYER_UM = 7.6  # a print that ends further off its height has run away (assumed)
CASES = tuple(
    replace(case, planners=(OURS, PAPERS, OPEN_LOOP))
    for case in (
        *CYLINDERS,
        Case("cuboid 8 x 8, 22.8 um, 20 %", SCENARIOS / "cuboid.toml",
             (Wanted("mean_height", 0.2, wanted=22.8, printed="22.3"), Wanted("std", 0.6, 0.45, printed="4.4"))),
        Case("pipe junction 100 x 100, two inks, 20 %", SCENARIOS / "pipe-junction.toml",
             (Wanted("mismatch", 4.0, 3.6), Wanted("mae", 0.8, 0.5)), seeds=2),
    )
)  # fmt: skip
ALPHAS = tuple(
    Case(
        f"cylinder, 20 %, alpha {alpha}",
        SCENARIOS / "cylinder.toml",
        (Wanted("mean_error", FULL_LAYER_UM, wanted=0.0), Wanted("std")),
        {"components.controller.alpha": alpha},
        3,
        (OURS, PAPERS),
    )
    for alpha in (1.0, 0.8, 0.5, 0.3, 0.2, 0.1)
)
"""From the most weight on height down: with less of it the part is to end more even."""


def measure(seeds: int) -> Table:
    """Errors of the last surface over the part, mean and scatter over at most so many seeds, and their targets."""
    metrics = printed((*CASES, *ALPHAS), seeds)
    rows = {case.name: figures(case, metrics) for case in (*CASES, *ALPHAS)}
    for more, less in pairwise(ALPHAS):
        bias, std = rows[less.name]
        rows[less.name] = [bias, replace(std, aim=float(np.mean(rows[more.name][1].ours)))]
    return table("whole prints; 20 %: up to this share of each droplet is missing", rows)
