"""One drop of each deposition model: a layer through FMI less the empty step, over the drops in it."""

from __future__ import annotations

import itertools

import numpy as np
from rich.table import Table

from benchmarks.timing import scaled, seconds
from inkloop.fmu import FmuComponent
from inkloop.fmu_writer.export import find_fmu
from inkloop.units import NS_PER_S

CASES: dict[str, tuple[str, dict[str, object]]] = {
    "LayerDeposition": ("LayerDeposition", {}),
    "the same, reach 2": ("LayerDeposition", {"reach": 2, "h4_a": 1e-7, "h5_a": 5e-8, "h6_a": 2e-8}),
    "the same, reach 3": ("LayerDeposition", {"reach": 3, **{f"h{k}_a": 5e-8 for k in range(4, 11)}}),
    "SuperpositionDeposition": ("SuperpositionDeposition", {}),
    "VolumeAreaDeposition": ("VolumeAreaDeposition", {}),
    "the same, guarded": ("VolumeAreaDeposition", {"guard": True, "limit_gains": True}),
}
SIDES = (25, 100, 500)


def measure() -> Table:
    """Time per drop."""
    table = Table(title="deposition models: time per drop, pattern half full at random")
    for heading in ("model", *(f"{side} x {side}" for side in SIDES)):
        table.add_column(heading, justify="left" if heading == "model" else "right")
    for name, (model, parameters) in CASES.items():
        table.add_row(name, *(scaled(_per_drop(model, parameters, side)) for side in SIDES))
    return table


def _per_drop(model: str, parameters: dict[str, object], side: int) -> float:
    """Seconds of a layer less those of a step without one, over the drops in it."""
    pattern = (np.random.default_rng(1).random((side, side)) < 0.5).astype(np.int32)
    command = np.zeros((), dtype=np.int32)
    inputs = {"pattern": pattern, "layer_command": command}
    printer = FmuComponent(find_fmu(model, "fmi3"), structural={"nx": side, "ny": side}, parameters=parameters)
    try:
        printer.initialize(0, inputs)
        points = itertools.count()

        def step() -> None:
            printer.do_step(next(points) * NS_PER_S, NS_PER_S, inputs)

        def layer() -> None:
            command[...] += 1
            step()

        return (seconds(layer) - seconds(step)) / int(pattern.sum())
    finally:
        printer.terminate()
