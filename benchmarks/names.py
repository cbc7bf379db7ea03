"""Names of the benchmarks: each is a module here with a function `measure`."""

from __future__ import annotations

RECORDED = (
    "layer_map",
    "estimator",
    "one_layer",
    "master",
    "whole_layer",
    "controller_time",
    "time_limit",
    "columns",
)
"""Measured by `make benchmarks` for the page: some six minutes together."""
PRINTING = {"closed_loop": 10, "lying_scans": 3}
"""Print whole parts, with so many seeds if no number is given."""
NAMES = (*RECORDED, *PRINTING)
"""Run by `python -m benchmarks` if none is named."""
