"""A print of 6 x 6 cells and five layers, as our master does it, and how prints of others compare with it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from inkloop.printing.print import Print
from inkloop.scenario.file import Scenario

SHAPE = (6, 6)
LAYERS = 5
STEPS_S = (0.7, 1.0, 5.0)
TIME_MAX_S = 120.0
TEXT = f"""
title = "six by six"
seed = 5
grid = {{ nx = 6, ny = 6 }}
part = {{ shape = "cuboid", height_um = 30.0, size_x_um = 1100.0, size_y_um = 1100.0 }}
[components.controller]
kind = "LayerController"
horizon = 2
[components.printer]
kind = "LayerDeposition"
variation = 0.2
layer_duration_s = 2.0
[components.profiler]
kind = "ProfileSensor"
noise_std_um = 0.2
scan_duration_s = 3.0
[run]
layers_max = {LAYERS}
"""
"""Droplets vary, scans are noisy, and both take time: a master that loses or doubles a layer prints another part."""


def scenario_in(folder: Path) -> Scenario:
    """The scenario, written to a folder."""
    (folder / "block.toml").write_text(TEXT, encoding="utf-8")
    return Scenario.load(folder / "block.toml")


def our_run(folder: Path) -> Any:
    """The dataset of our own master's print."""
    run = Print(scenario_in(folder)).run().dataset
    assert run.sizes["layer"] == LAYERS + 1
    return run


def difference(found: Any, expected: Any) -> str:
    """A message on the difference of two prints; "" where every bit is the same."""
    for layer, (one, other) in enumerate(zip(found, expected, strict=False), start=1):
        if not np.array_equal(one, other):
            return f"layer {layer} differs by up to {np.abs(one - other).max():.2g}"
    return "" if len(found) == len(expected) else f"{len(found)} layers instead of {len(expected)}"
