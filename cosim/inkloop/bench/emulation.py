"""What an emulated bench is to be like, so that a scenario prints on it what it prints with our FMUs, bit for bit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from inkloop.component import FloatMap
from inkloop.components import devices
from inkloop.components.fmu_parameters import parse_model
from inkloop.errors import ScenarioError
from inkloop.scenario.file import Scenario
from inkloop.tables.bench_faults import FaultTable

_SEEDS = {"LayerDeposition": "printer_seed", "ProfileSensor": "sensor_seed"}
_EMULATED = {
    "LayerDeposition": (
        *(f"h{order}_{ink}" for ink in "ab" for order in (1, 2, 3)),
        *("variation", "variation_kind", "nozzle_variation", "nozzle_pitch"),
    ),
    "ProfileSensor": (
        *("pitch", "noise_std", "noise_correlation", "resolution", "bias", "drift_rate", "tilt_x", "tilt_y"),
        *("spot_radius", "slope_bias", "dropout_slope", "dropout_rate"),
    ),
}
"""Parameters of the models that the emulated bench has too, under the same names."""
_SAID_OTHERWISE = {"pitch", "passes", "pass_order", "pass_rotation", "layer_duration", "scan_duration", "height_start"}
"""Told to the nodes by the master, by files, or by the times of the nodes."""


@dataclass(frozen=True, eq=False)
class Emulation:
    """Options of the emulated bench in SI, the surface to print on (nx, ny) [m], flat if None, and what goes wrong."""

    parameters: dict[str, float] = field(default_factory=dict)
    surface: FloatMap | None = None
    faults: tuple[FaultTable, ...] = ()


def emulation_of(scenario: Scenario) -> Emulation:
    """The bench that stands for printer and profiler of a scenario, devices or our FMUs.

    Raises ScenarioError with every option that only the FMUs have.
    """
    grid = scenario.tables.grid
    parameters: dict[str, float] = {"nx": grid.nx, "ny": grid.ny}
    errors: list[str] = []
    for name, table in scenario.tables.components.items():
        model = devices.KINDS[table.kind].model if table.kind in devices.KINDS else table.kind
        if model not in _EMULATED:
            continue
        values = parse_model(model, scenario.job(name), table.options).values
        errors += [f"components.{name}.{error}" for error in _unknown(model, values)]
        parameters |= {key: value.item() for key, value in values.items() if key in _EMULATED[model]}
        parameters[_SEEDS[model]] = values["seed"].item()
    if errors:
        raise ScenarioError(scenario.source, errors)
    return Emulation(parameters, scenario.job().height_start, tuple(scenario.tables.bench.faults))


def _unknown(model: str, values: Mapping[str, Any]) -> list[str]:
    known = {*_EMULATED[model], *_SAID_OTHERWISE, "seed", "nx", "ny"}
    return [f"{name} is not emulated on a bench; leave it out" for name in values if name not in known]
