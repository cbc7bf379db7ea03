"""Processor time of the estimate after a scan, per cell."""

from __future__ import annotations

from functools import partial
from time import process_time

import numpy as np
from rich.table import Table

from benchmarks.time_limit import NOISE_M, VARIATION, block
from benchmarks.timing import scaled
from inkloop_controller.core import bindings
from inkloop_controller.estimation.height_estimator import HeightEstimator

SIDES = (100, 500, 1000)
COVERAGES = {"full": 1.0, "four fifths of the cells": 0.8}
CELLS = 10_000_000  # estimated for each figure


def measure() -> Table:
    """The least of many calls, in the middle of a print of one ink, on one thread."""
    table = Table(title="estimate after a scan, processor time of one core, least of many")
    for heading in ("layers", "grid", "per scan", "per cell"):
        table.add_column(heading, justify="left" if heading == "layers" else "right")
    for layers, coverage in COVERAGES.items():
        for side in SIDES:
            least = _least(side, coverage)
            table.add_row(layers, f"{side} x {side}", scaled(least), scaled(least / side**2))
    return table


def _least(side: int, coverage: float) -> float:
    """Seconds of the estimate after the second of two layers with that share of droplets."""
    job, rng = block(side, 20), np.random.default_rng(0)
    estimator, seen, height = HeightEstimator(job), np.ones((side, side), np.bool_), np.zeros((side, side))
    estimate = estimator.first(height, seen)
    for layer in (1, 2):
        pattern = np.asarray(job.mask & (rng.random(height.shape) < coverage), np.int32)
        factor = 1.0 + VARIATION * rng.uniform(-1.0, 1.0, height.shape)
        height = bindings.layer(height, pattern, job.inks, factor=factor)
        scan = height + NOISE_M * rng.standard_normal(height.shape)
        again = partial(estimator.next, estimate, pattern, layer, scan, seen)
        estimate = again()
    times = []
    for _ in range(max(3, CELLS // side**2)):
        begin = process_time()
        again()
        times.append(process_time() - begin)
    return min(times)
