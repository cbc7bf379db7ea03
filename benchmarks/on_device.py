"""The plan of a grid of a million cells on a GPU, and on all cores of the processor."""

from __future__ import annotations

import os
from functools import partial
from importlib import import_module
from math import inf

import numpy as np
from rich.table import Table
from rich.text import Text

from benchmarks.timing import scaled, table_of, timed
from inkloop.errors import InkloopError, require
from inkloop.testing import job
from inkloop.units import UM_PER_M
from inkloop_controller.core.layer_step import LayerStep
from inkloop_controller.planning.horizon_planner import best_plan
from support.layer_problems import nearly_flat

SIDE = 1000
HORIZONS = (3, 5)


def measure(side: int = SIDE) -> Table | Text:
    """Wall time and objective of both, alpha 1; a sentence where there is no GPU."""
    try:
        require("pyopencl", "a plan on a GPU")
        device = import_module("inkloop_controller.gpu.device")
        name = device.described(device.chosen_device())
        search = import_module("inkloop_controller.gpu.search").DeviceSearch()
    except InkloopError as error:
        return Text(str(error))
    cores = os.cpu_count() or 1
    title = f"plan of a nearly flat surface of {side} x {side} cells, alpha 1, wall time"
    table = table_of(title, ("horizon", f"{cores} cores", "um", f"{name}, kernels compiled", "um"))
    step = LayerStep(job(), layer_worth=0.0, threads=cores)
    for layers in HORIZONS:
        problem = nearly_flat((side, side), layers)
        last = np.zeros((0, side, side), np.int32)
        plan = partial(best_plan, step, 1, problem, last=last, seconds_max=inf)
        plan(device=search)  # compiles the kernels
        cells = (
            text
            for found, _, wall in (timed(plan), timed(partial(plan, device=search)))
            for text in (scaled(wall), f"{found.objective.value * UM_PER_M:.4f}")
        )
        table.add_row(str(layers), *cells)
    return table
