"""Options of an emulator that prints a scenario bit for bit as inkloop's FMUs do."""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass, field
from typing import Any

from inkloop.component import FloatMap
from inkloop.components import devices
from inkloop.components.fmu_parameters import parse_model
from inkloop.errors import ScenarioError
from inkloop.fmu_writer.archive import read_definition
from inkloop.scenario.file import Scenario
from inkloop.tables.bench_faults import FaultTable
from inkloop.units import MS_PER_S

NODE_CELLS_MAX = 1_000_000
"""Cells that a node of the bench holds (PATTERN_CELLS_MAX of the firmware)."""
_SEEDS = {"LayerDeposition": "printer_seed", "ProfileSensor": "sensor_seed"}
"""Models that the emulator stands for, and its names of their seeds. Its other parameters have the same names: those
that variables.toml calls emulated."""
_SAID_OTHERWISE = {"pitch", "passes", "pass_order", "pass_rotation", "layer_duration", "scan_duration", "height_start"}
"""Parameters set for the nodes by the master, by files, or by the times of the nodes."""


@dataclass(frozen=True, eq=False)
class Emulation:
    """Options of the emulator in SI, the surface to print on (nx, ny) [m], flat if None, and its faults."""

    parameters: dict[str, float] = field(default_factory=dict)
    surface: FloatMap | None = None
    faults: tuple[FaultTable, ...] = ()


def emulation_of(scenario: Scenario) -> Emulation:
    """The bench that stands for printer and profiler of a scenario, devices or our FMUs.

    Raises ScenarioError with every option that only the FMUs have.
    """
    grid = scenario.tables.grid
    parameters: dict[str, float] = {"nx": grid.nx, "ny": grid.ny}
    parameters |= dict.fromkeys(("alive_ms", "watchdog_ms"), round(scenario.tables.bench.silence_s * MS_PER_S))
    errors: list[str] = []
    if grid.nx * grid.ny > NODE_CELLS_MAX:
        errors.append(
            f"grid of {grid.nx} x {grid.ny} cells: the nodes of the bench hold up to {NODE_CELLS_MAX:,} cells; "
            "choose a smaller grid or a larger pitch"
        )
    for name, table in scenario.tables.components.items():
        model = devices.KINDS[table.kind].model if table.kind in devices.KINDS else table.kind
        if model not in _SEEDS:
            continue
        parsed = parse_model(model, scenario.job(name), table.options)
        values = parsed.values
        emulated = {variable.name for variable in read_definition(parsed.description.path).emulated}
        errors += [f"components.{name}.{error}" for error in _unknown(emulated, values)]
        parameters |= {key: value.item() for key, value in values.items() if key in emulated}
        parameters[_SEEDS[model]] = values["seed"].item()
    if errors:
        raise ScenarioError(scenario.source, errors)
    return Emulation(parameters, scenario.job().height_start, tuple(scenario.tables.bench.faults))


def _unknown(emulated: Set[str], values: Mapping[str, Any]) -> list[str]:
    known = {*emulated, *_SAID_OTHERWISE, "seed", "nx", "ny"}
    return [f"{name} is not emulated on a bench; leave it out" for name in values if name not in known]
