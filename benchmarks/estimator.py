"""Time of the estimate after a scan, per cell."""

from __future__ import annotations

from functools import partial

import numpy as np
from rich.table import Table

from benchmarks.time_limit import NOISE_M, VARIATION, block
from benchmarks.timing import scaled, table_of, timed
from inkloop_controller.core import bindings
from inkloop_controller.estimation.height_estimator import HeightEstimator

SIDES = (100, 500, 1000)
COVERAGES = {"full": 1.0, "four fifths of the cells": 0.8}
CELLS = 10_000_000  # estimated for each figure


def measure() -> Table:
    """The least of many calls, in the middle of a print of one ink."""
    headings = ("layers", "grid", "processor time", "per cell", "wall", "two threads, wall", "gain")
    table = table_of("estimate after a scan, least of many; two threads have the same bits", headings, texts=1)
    for layers, coverage in COVERAGES.items():
        for side in SIDES:
            processor, wall = _least(side, coverage)
            _, together = _least(side, coverage, threads=2)
            table.add_row(
                layers,
                f"{side} x {side}",
                scaled(processor),
                scaled(processor / side**2),
                scaled(wall),
                scaled(together),
                f"{wall / together:.2f}",
            )
    return table


def _least(side: int, coverage: float, threads: int = 1) -> tuple[float, float]:
    """Processor and wall time [s] of the estimate after the second of two layers with that share of droplets."""
    job, rng = block(side, 20), np.random.default_rng(0)
    estimator, height = HeightEstimator(job, threads=threads), np.zeros((side, side))
    seen = np.ones(height.shape, np.bool_)
    estimate = estimator.first(height, seen)
    for layer in (1, 2):
        pattern = np.asarray(job.mask & (rng.random(height.shape) < coverage), np.int32)
        factor = 1.0 + VARIATION * rng.uniform(-1.0, 1.0, height.shape)
        height = bindings.layer(height, pattern, job.inks, factor=factor)
        scan = height + NOISE_M * rng.standard_normal(height.shape)
        again = partial(estimator.next, estimate, pattern, layer, scan, seen)
        estimate = again()
    times = [timed(again) for _ in range(max(3, CELLS // side**2))]
    return min(each.processor_s for each in times), min(each.wall_s for each in times)
