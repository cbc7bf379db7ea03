"""Collect the content of LayerJob.fmu from a scenario, and report everything it cannot hold."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from inkloop import contract
from inkloop.component import Job
from inkloop.components import catalog
from inkloop.errors import ScenarioError
from inkloop.exchange.ssp.system import CONTROLLER, PYTHON_CONTROLLER, Part, System, Wire, system_of
from inkloop.files import temporary_folder
from inkloop.fmu_writer.export import INTERVALS
from inkloop.scenario.file import Scenario

ROLES: Mapping[str, tuple[str, ...]] = {
    contract.PRINTER: catalog.DEPOSITION_MODELS,
    contract.PROFILER: ("ProfileSensor",),
    contract.CONTROLLER: (CONTROLLER,),
}
"""The parts of a job, in the order of its file, and the models that can be each of them."""
CONTRACT = frozenset(
    (signal.giver, taker, signal.name) for signal in contract.SIGNALS.values() for taker in signal.takers
)
"""(source, target, signal) as the block wires its parts."""


@dataclass(frozen=True, eq=False)
class Bake:
    """Content of a block. parts: by role its model and parameters; own: start values of the block's parameters.

    intervals: most height intervals of the region of ink A on a cell.
    """

    title: str
    scenario_text: str
    job: Job
    parts: Mapping[str, tuple[str, Mapping[str, NDArray[Any]]]]
    own: Mapping[str, float]
    stop_s: float
    intervals: int


def bake(scenario: Scenario) -> Bake:
    """The parameters that `inkloop export ssp` writes too. Raises ScenarioError with every obstacle, FmuError."""
    with temporary_folder("job") as folder:
        system = system_of(scenario, "3", Path(folder))
    roles = _roles(system)
    if obstacles := list(_obstacles(scenario, system, roles)):
        raise ScenarioError(scenario.source, obstacles)
    parts = {role: system.part(name) for name, role in roles.items()}
    values = {role: (parts[role].description.name, dict(parts[role].values)) for role in ROLES}
    durations = {
        "layer_duration": _value(parts[contract.PRINTER], "layer_duration"),
        "scan_duration": _value(parts[contract.PROFILER], "scan_duration"),
    }
    own = {
        "layer_period": max(scenario.tables.run.step_s, sum(durations.values())),
        **durations,
        "layers_max": scenario.tables.run.layers_max,
        **{name: _value(parts[contract.CONTROLLER], name) for name in ("alpha", "time_limit")},
    }
    intervals = int(_value(parts[contract.CONTROLLER], INTERVALS))
    return Bake(scenario.tables.title, scenario.text, scenario.job(), values, own, system.stop_s, intervals)


def _roles(system: System) -> dict[str, str]:
    """Role by component, where its model has one."""
    models = {model: role for role, models in ROLES.items() for model in models}
    return {part.name: models[part.description.name] for part in system.parts if part.description.name in models}


def _obstacles(scenario: Scenario, system: System, roles: Mapping[str, str]) -> Iterator[str]:
    ours = (PYTHON_CONTROLLER, *catalog.FMU_MODELS)
    strange = {name: table.kind for name, table in scenario.tables.components.items() if table.kind not in ours}
    for name in {**strange, **system.outside}:
        reason = system.outside.get(name, f"kind {strange.get(name)} is an FMU of its own")
        yield f"components.{name}: {reason}; a block is made of {', '.join(ours)}"
    for role, models in ROLES.items():
        names = [name for name, found in roles.items() if found == role]
        if len(names) > 1:
            yield f"{' and '.join(names)} are each a {role}; a block has one: keep one"
        elif not names and not strange and not system.outside:
            yield f"no component is the {role} of the block; add one of kind {' or '.join(models)}"
    if system.has_events:
        yield "[[events]] are changes that a block knows nothing of; take them out, and let the importer change inputs"
    yield from _wiring_obstacles(system.wires, roles)


def _wiring_obstacles(wires: Sequence[Wire], roles: Mapping[str, str]) -> Iterator[str]:
    for wire in wires:
        (source, output), (target, port) = wire.source, wire.target
        if source not in roles or target not in roles:
            continue
        place = f"connections: {source}.{output} to {target}.{port}"
        if output != port or (roles[source], roles[target], port) not in CONTRACT:
            yield f"{place} is none of the layer contract, by which a block wires its parts; take it out"
        elif wire.gain != 1.0 or wire.offset != 0.0:
            yield f"{place} has a gain or an offset, and a block wires its parts without; take it out"


def _value(part: Part, name: str) -> float:
    """A scalar parameter of a part, in SI."""
    return float(part.values[name] if name in part.values else part.variable(name).start[0])
