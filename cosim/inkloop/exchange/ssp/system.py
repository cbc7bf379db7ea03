"""A scenario as a system of FMUs: its FMUs, the wires between them, and the parts left outside."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from inkloop.component import HasPorts, Job
from inkloop.components import catalog, fmu_parameters
from inkloop.components.port_tables import OPTION as PORTS
from inkloop.errors import FmuError, ScenarioError
from inkloop.exchange.ssp import omsimulator
from inkloop.fmu import FmuDescription, Variable, describe
from inkloop.fmu.reading import fmu_file
from inkloop.fmu.variable import TEXT
from inkloop.fmu_writer.export import INTERVALS, export_fmu
from inkloop.master.wiring import Connection, Transfer
from inkloop.scenario.file import Scenario

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")
CONTROLLER = "LayerController"
PYTHON_CONTROLLER = "LayerMpc"
"""Kind of the Python controller that the FMU replaces, where it has all of its options."""


@dataclass(frozen=True, eq=False)
class Part:
    """An FMU of the system. values: its parameters that differ from its own start values, in its units."""

    name: str
    file: Path
    description: FmuDescription
    values: Mapping[str, NDArray[Any]]

    def variable(self, port: str) -> Variable:
        """The variable of a port."""
        return self.description.variables[port]

    def scalars(self, port: str) -> tuple[str, ...]:
        """The names under which a port is connected: one for each element where FMI 2 scatters it."""
        return self.variable(port).elements or (port,)

    def shape(self, port: str) -> tuple[int, ...]:
        """Lengths along the dimensions of an array of FMI 3."""
        return () if self.description.fmi == 2 else self.variable(port).shape(self.description.default_sizes)


@dataclass(frozen=True)
class Wire:
    """From an output to an input, each (part, port), "" for the outside, whose port has the name of the signal.

    transfer: conversion on the way, units included; gain and offset: the same without the units.
    """

    source: tuple[str, str]
    target: tuple[str, str]
    gain: float
    offset: float
    transfer: Transfer


@dataclass(frozen=True)
class System:
    """The system of a scenario; times in seconds. name: an identifier; outside: components that are no FMU, with the
    reason.
    """

    name: str
    title: str
    parts: Sequence[Part]
    wires: Sequence[Wire]
    outside: Mapping[str, str]
    step_s: float
    stop_s: float
    scenario_text: str
    has_events: bool = False

    def part(self, name: str) -> Part:
        """The part of a name."""
        return next(part for part in self.parts if part.name == name)

    def pairs(self, wire: Wire) -> Iterator[tuple[str, str]]:
        """The names at both ends of a wire, one pair for each scalar that it carries."""
        ends = [self.part(part).scalars(port) if part else None for part, port in (wire.source, wire.target)]
        source, target = ends
        if source is None:
            source = _outside_names(wire.source[1], wire.target[1], target or ())
        if target is None:
            target = _outside_names(wire.target[1], wire.source[1], source)
        return zip(source, target, strict=True)

    def notes(self) -> list[str]:
        """Remaining tasks of the user, one sentence for each part outside."""
        notes = [f"{name} is not in it: {reason}" for name, reason in self.outside.items()]
        if self.has_events:
            notes.append("the events of the scenario are not in it: inkloop alone knows them")
        if refused := omsimulator.refused(part.name for part in self.parts):
            notes.append(f"OMSimulator takes letters, digits and _ in names: rename {', '.join(refused)} for it")
        return notes


def system_of(scenario: Scenario, fmi: str, folder: Path) -> System:
    """The system of a scenario; its FMUs for FMI `fmi` ("2": scalars, "3": arrays) are written to `folder`.

    Raises ScenarioError if it has no FMU or a wire cannot be expressed.
    """
    parts: dict[str, Part] = {}
    outside: dict[str, str] = {}
    for name, table in scenario.tables.components.items():
        options = scenario.options(name)
        made = _part(name, table.kind, scenario.job(name), options, fmi, folder)
        if isinstance(made, Part):
            parts[name] = made
        else:
            outside[name] = made
    if bad := [name for name in parts if not _NAME.fullmatch(name)]:
        advice = "other tools take letters, digits, _ and - in names; rename it"
        raise ScenarioError(scenario.source, [f"components.{name}: {advice}" for name in bad])
    if not parts:
        reasons = [f"{name}: {reason}" for name, reason in outside.items()]
        raise ScenarioError(scenario.source, ["none of its components is an FMU that could be packed", *reasons])
    if turned := [wire for wire in scenario.connections if not wire.orientation.is_own]:
        errors = [f"connections: {wire.source} to {wire.target} turns a map, which SSP cannot say" for wire in turned]
        raise ScenarioError(scenario.source, errors)
    wires = _wires(scenario.connections, scenario.ports, parts)
    title, step_s, has_events = scenario.tables.title, scenario.tables.run.step_s, bool(scenario.tables.events)
    stop_s = _stop_s(scenario, parts)
    name = omsimulator.identifier(Path(scenario.source).stem)
    system = System(name, title, list(parts.values()), wires, outside, step_s, stop_s, scenario.text, has_events)
    if errors := list(_form_errors(system)):
        raise ScenarioError(scenario.source, errors)
    return system


def _part(name: str, kind: str, job: Job, options: Mapping[str, object], fmi: str, folder: Path) -> Part | str:
    """The part of a component, or the reason why it stays outside."""
    if kind == PYTHON_CONTROLLER:
        return _controller(name, job, options, fmi, folder)
    if kind in catalog.FMU_MODELS:
        return _model(name, kind, job, options, fmi, folder)
    if kind == "Fmu":
        return _foreign(name, job, options, fmi, folder)
    if kind == catalog.PLAIN_PLANT:
        return "inkloop keeps the handshake for this plant, its FMU alone would not follow layer_command"
    return f"kind {kind} is no FMU"


def _controller(name: str, job: Job, options: Mapping[str, object], fmi: str, folder: Path) -> Part | str:
    options = fmu_parameters.options_of_controller_fmu(options)
    try:
        errors = fmu_parameters.parse_model(CONTROLLER, job, options).errors
    except FmuError as error:
        return f"kind {PYTHON_CONTROLLER} runs in Python, and {error}"
    if errors:
        return f"{CONTROLLER}.fmu cannot stand in for it: {'; '.join(errors)}"
    return _model(name, CONTROLLER, job, options, fmi, folder)


def _model(name: str, model: str, job: Job, options: Mapping[str, object], fmi: str, folder: Path) -> Part | str:
    parsed = fmu_parameters.parse_model(model, job, options)
    file = export_fmu(
        model,
        fmi="2" if fmi == "2" else "3",
        nx=job.nx,
        ny=job.ny,
        intervals=parsed.structural.get(INTERVALS),
        fixed=True,
        out=folder / f"{name}.fmu",
    )
    return _with_values(Part(name, file, describe(file), parsed.values))


def _foreign(name: str, job: Job, options: Mapping[str, object], fmi: str, folder: Path) -> Part | str:
    if PORTS in options:
        return "inkloop translates its names, units and gains (ports), which a system file does not hold"
    file = folder / f"{name}.fmu"
    with fmu_file(Path(str(options["file"]))) as found:
        shutil.copyfile(found, file)
    description = describe(file)
    if fmi == "2" and description.fmi != 2:
        return f"{options['file']} is FMI {description.fmi}, all else FMI 2"
    return _with_values(Part(name, file, description, fmu_parameters.values_of_file(description, job, options)))


def _with_values(part: Part) -> Part:
    """Values that differ from the FMU's start values."""
    kept = {name: value for name, value in part.values.items() if _is_changed(part.variable(name), value)}
    return replace(part, values=kept)


def _is_changed(variable: Variable, value: NDArray[Any]) -> bool:
    if variable.type == TEXT:
        return str(value) != "".join(variable.start)
    numbers = [float({"true": 1, "false": 0}.get(text, text)) for text in variable.start]
    return len(numbers) not in (1, value.size) or bool((value.ravel() != numbers).any())


def _wires(
    connections: Sequence[Connection], components: Mapping[str, HasPorts], parts: Mapping[str, Part]
) -> list[Wire]:
    """The wires between two parts, and those between a part and the outside, each signal of the outside once."""
    inputs = {(name, port.name): port for name, part in components.items() for port in part.inputs}
    outputs = {(name, port.name): port for name, part in components.items() for port in part.outputs}
    wires, given = [], set()
    for connection in connections:
        source, target = connection.source_parts, connection.target_parts
        if source[0] not in parts and target[0] not in parts:
            continue
        transfer = Transfer.of(connection, outputs[source], inputs[target])
        gain, offset = (1.0 if connection.gain is None else connection.gain), connection.offset
        if target[0] not in parts:  # outside, the receiving tool decides
            target, gain, offset, transfer = ("", source[1]), 1.0, 0.0, Transfer()
            if source in given:
                continue
            given.add(source)
        wires.append(Wire(source if source[0] in parts else ("", source[1]), target, gain, offset, transfer))
    return wires


def _form_errors(system: System) -> Iterator[str]:
    for wire in system.wires:
        (source, output), (target, port) = wire.source, wire.target
        if source and target and len(system.part(source).scalars(output)) != len(system.part(target).scalars(port)):
            yield (
                f"{source}.{output} and {target}.{port}: one is an array, the other one scalars, which no connection "
                "joins; --fmi 2 exports inkloop's FMUs with scalars, or export the other one for FMI 3"
            )


def _stop_s(scenario: Scenario, parts: Mapping[str, Part]) -> float:
    """Time at which a print should be over: thrice the nominal layers and five, three steps for each."""
    limits, job = scenario.tables.run, scenario.job()
    if limits.time_max_s is not None:
        return limits.time_max_s
    layers = min(3 * round(float(job.target_height.max()) / job.inks[0].layer_height) + 5, limits.layers_max)
    durations = ("layer_duration", "scan_duration")
    waits = sum(float(part.values.get(name, 0.0)) for part in parts.values() for name in durations)
    return limits.step_s * (3 * layers + 1) + waits * layers


def _outside_names(signal: str, port: str, scalars: Sequence[str]) -> tuple[str, ...]:
    """The names of the scalars of a port, with the name of the signal in place of the port's."""
    return tuple(signal + scalar.removeprefix(port) for scalar in scalars)
