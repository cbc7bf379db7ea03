"""Measured comparisons: ours against floors and peers in the same run, and against targets."""

import os
import sys
from pathlib import Path

# The peers in NumPy are the evaluations that the tests compare with.
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

RECORDED = (
    "layer_map",
    "estimator",
    "one_layer",
    "master",
    "whole_layer",
    "controller_time",
    "time_limit",
    "columns",
    "bench_bus",
)
"""Modules here with a function `measure`, measured by `make benchmarks` for the page: some six minutes together."""
PRINTING = {"closed_loop": 10, "lying_scans": 3}
"""Print whole parts, with so many seeds if no number is given."""
NAMES = (*RECORDED, "on_device", *PRINTING)
"""Run by `python -m benchmarks` if none is named."""


def use_one_thread() -> None:
    """Plan, estimate and multiply matrices on one thread where a benchmark names no other number; before NumPy."""
    os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
