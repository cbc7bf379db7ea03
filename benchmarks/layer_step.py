"""One layer of `LayerDeposition` through FMI, compared with NumPy and with the FMI calls alone."""

from __future__ import annotations

import itertools

import numpy as np
from rich.table import Table

from benchmarks.timing import scaled, seconds
from inkloop.fmu import FmuComponent
from inkloop.fmu_writer.export import find_fmu
from inkloop.units import NS_PER_S
from support.numpy.lu_numpy import one_pass

SIDES = (20, 50, 100, 200, 500, 1000, 2000)


def measure() -> Table:
    """Time per cell of a full layer on a rough surface, without variation."""
    table = Table(title="one layer per cell: set pattern, step, get height")
    for heading in ("grid", "FMU", "of it FMI calls", "NumPy", "NumPy / FMU", "FMU / FMI calls"):
        table.add_column(heading, justify="right")
    for side in SIDES:
        fmu, calls, numpy_layer = (time / side**2 for time in _times(side))
        row = (scaled(fmu), scaled(calls), scaled(numpy_layer), f"{numpy_layer / fmu:.1f}", f"{fmu / calls:.1f}")
        table.add_row(f"{side} x {side}", *row)
    return table


def _times(side: int) -> tuple[float, float, float]:
    """Seconds of a layer by the FMU, of the same step without a command, and of a layer by NumPy."""
    rng = np.random.default_rng(1)
    height = rng.uniform(0.0, 8e-6, (side, side))
    pattern = (rng.random((side, side)) < 0.9).astype(np.int32)
    command = np.zeros((), dtype=np.int32)
    printer = FmuComponent(
        find_fmu("LayerDeposition", "fmi3"), structural={"nx": side, "ny": side}, parameters={"height_start": height}
    )
    inputs = {"pattern": pattern, "layer_command": command}
    try:
        printer.initialize(0, inputs)

        points = itertools.count()

        def step() -> None:
            printer.do_step(next(points) * NS_PER_S, NS_PER_S, inputs)

        def layer() -> None:
            command[...] += 1
            step()

        return seconds(layer), seconds(step), seconds(lambda: one_pass(height, pattern))
    finally:
        printer.terminate()
