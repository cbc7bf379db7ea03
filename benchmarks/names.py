"""Names of the benchmarks: each is a module here with a function `measure`."""

from __future__ import annotations

NAMES = (
    "layer_map",
    "layer_step",
    "deposition_models",
    "young_laplace",
    "remeshing",
    "startup",
    "master",
    "whole_layer",
    "scaling",
    "time_limit",
    "estimator",
    "one_layer",
    "columns",
    "controller_step",
    "controller_time",
    "footprint",
    "sweep",
    "peers",
    "targets",
    "closed_loop",
    "lying_scans",
)
"""Run by `python -m benchmarks` if none is named."""
ALONE = ("hardware", "bench_faults")
"""Run only when named: they want the machine for themselves."""
PRINTING = {"targets": 10, "closed_loop": 10, "lying_scans": 3}
"""Print whole parts, with so many seeds if no number is given."""
RECORDED = (
    "layer_map",
    "layer_step",
    "estimator",
    "one_layer",
    "master",
    "whole_layer",
    "controller_time",
    "time_limit",
    "peers",
    "columns",
    "startup",
)
"""What `make benchmarks` measures for the page: some ten minutes together."""
