"""The two JSON files of Maestro: the multi-model (FMUs, connections, parameters) and the run's configuration.

Maestro 3.1.1 stops at the first enumeration of a description: the FMUs in the same folder declare them as integers.
https://into-cps-maestro.readthedocs.io/en/latest/user/file_formats.html
"""

from __future__ import annotations

from typing import Any

from inkloop.errors import ScenarioError
from inkloop.exchange.ssp.system import System

MULTI_MODEL, CONFIGURATION = "multimodel.json", "simulation.json"


def tables(system: System) -> dict[str, dict[str, Any]]:
    """Both files by name. Raises ScenarioError."""
    return {MULTI_MODEL: multi_model(system), CONFIGURATION: configuration(system)}


def multi_model(system: System) -> dict[str, Any]:
    """The configuration; FMUs are in the same folder. Raises ScenarioError for unsupported names and wires."""
    connections: dict[str, list[str]] = {}
    errors = [
        f"components.{part.name}: Maestro takes letters, digits and _ in names; rename it"
        for part in system.parts
        if "-" in part.name
    ]
    for wire in system.wires:
        if not (wire.source[0] and wire.target[0]):
            continue
        if not wire.transfer.is_plain:
            errors.append(
                f"{'.'.join(wire.source)} to {'.'.join(wire.target)} has a gain, an offset or two units, which "
                "connections of Maestro do not know; put it into an FMU"
            )
        for source, target in system.pairs(wire):
            connections.setdefault(_place(wire.source[0], source), []).append(_place(wire.target[0], target))
    if errors:
        raise ScenarioError(system.title, errors)
    return {
        "fmus": {f"{{{part.name}}}": f"{part.name}.fmu" for part in system.parts},
        "connections": connections,
        "parameters": {
            _place(part.name, element): number
            for part in system.parts
            for name, value in part.values.items()
            if part.variable(name).type != "Enumeration"  # those stand in the FMU, as start values of integers
            for element, number in zip(part.scalars(name), value.ravel().tolist(), strict=True)
        },
    }


def configuration(system: System) -> dict[str, Any]:
    """Times and step of the run, and what it records: outputs that are scalars or connected, no further maps."""
    connected = {wire.source for wire in system.wires}
    return {
        "startTime": 0.0,
        "endTime": system.stop_s,
        "algorithm": {"type": "fixed-step", "size": system.step_s},
        "loggingOn": False,
        "visible": False,
        "parallelSimulation": False,
        "simulationProgramDelay": False,
        "logVariables": {
            f"{{{part.name}}}.{part.name}": [
                scalar
                for name, variable in part.description.variables.items()
                if variable.causality == "output"
                if part.scalars(name) == (name,) or (part.name, name) in connected
                for scalar in part.scalars(name)
            ]
            for part in system.parts
        },
    }


def _place(part: str, variable: str) -> str:
    return f"{{{part}}}.{part}.{variable}"
