"""Liquid lines under surface tension: a droplet, and the square that took Hume and Rosen (2018) about 15 minutes."""

from __future__ import annotations

from statistics import median
from time import process_time

import numpy as np
from rich.table import Table

from benchmarks.timing import scaled
from inkloop.fmu import FmuComponent
from inkloop.fmu_writer.export import find_fmu
from inkloop.units import NS_PER_S

MODEL = "YoungLaplaceDeposition"
PAPER_S = 900.0
PAPER_DROPLET_S = {"linear": 1.19, "nonlinear": 8.33}
"""Their Table 2: elements of first order up to 5 um."""
LAYERS = 10


def measure() -> Table:
    """Processor time, and how many times faster than the paper's."""
    table = Table(title="YoungLaplaceDeposition, processor time; in brackets how many times faster than the paper")
    for heading in ("form", "points per pitch", "one droplet", "square, 25 x 25 x 10 droplets", "solved linearly"):
        table.add_column(heading, justify="left" if heading == "form" else "right")
    for form, paper_s in PAPER_DROPLET_S.items():
        for per_pitch in (8, 16):
            droplet_s = median(_printed(form, per_pitch, 3, 1, 1)[0] for _ in range(9))
            square_s, fallbacks = min(_printed(form, per_pitch, 29, 25, LAYERS) for _ in range(3))
            droplet = f"{scaled(droplet_s)} ({paper_s / droplet_s:.0f})"
            square = f"{scaled(square_s)} ({PAPER_S / square_s:.0f})"
            table.add_row(form, str(per_pitch), droplet, square, f"{fallbacks} of {25 * LAYERS}")
    return table


def _printed(form: str, per_pitch: int, cells: int, side: int, layers: int) -> tuple[float, int]:
    """Processor time [s] of full layers of side x side droplets on cells x cells, and how many bodies fell back."""
    pattern = np.pad(np.ones((side, side), dtype=np.int32), (cells - side) // 2)
    inputs = {"pattern": pattern, "drop_level": np.ones_like(pattern)}
    parameters = {"form": form, "cells_per_pitch": per_pitch}
    printer = FmuComponent(find_fmu(MODEL), structural={"nx": cells, "ny": cells}, parameters=parameters)
    try:
        printer.initialize(0, {**inputs, "layer_command": np.int32(0)})
        begin, fallbacks = process_time(), 0
        for layer in range(layers):
            outputs = printer.do_step(layer * NS_PER_S, NS_PER_S, {**inputs, "layer_command": np.int32(layer + 1)})
            fallbacks = int(outputs["fallbacks"])
        return process_time() - begin, fallbacks
    finally:
        printer.terminate()
