"""A folder with the FMUs of a system and its files for libcosim or Maestro.

libcosim: https://open-simulation-platform.github.io/libcosim/configuration; Maestro:
https://into-cps-maestro.readthedocs.io/en/latest/user/file_formats.html. Maestro 3.1.1 stops at the first enumeration
of a description: its FMUs declare them as integers.
"""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from inkloop.errors import ScenarioError
from inkloop.exchange.ssp.system import Part, System
from inkloop.files import new_folder, replaced, write_text
from inkloop.fmu_writer.description import add, to_bytes

MULTI_MODEL, CONFIGURATION = "multimodel.json", "simulation.json"


def maestro_tables(system: System) -> dict[str, dict[str, Any]]:
    """Both files of Maestro by name: the multi-model and the configuration of the run. Raises ScenarioError."""
    return {MULTI_MODEL: _multi_model(system), CONFIGURATION: _configuration(system)}


def _multi_model(system: System) -> dict[str, Any]:
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


def _configuration(system: System) -> dict[str, Any]:
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


OSP_FILE = "OspSystemStructure.xml"
_NAMESPACE = "http://opensimulationplatform.com/MSMI/OSPSystemStructure"


def osp_structure(system: System) -> bytes:
    """OspSystemStructure.xml. Wires to the outside are omitted: these inputs are overridden there."""
    root = ET.Element("OspSystemStructure", {"xmlns": _NAMESPACE, "version": "0.1"})
    for tag, text in (("StartTime", "0.0"), ("BaseStepSize", repr(system.step_s)), ("Algorithm", "fixedStep")):
        add(root, tag).text = text
    simulators = add(root, "Simulators")
    for part in system.parts:
        simulator = add(simulators, "Simulator", name=part.name, source=f"{part.name}.fmu", stepSize=system.step_s)
        values = list(_values(part))
        initial = add(simulator, "InitialValues") if values else simulator
        for name, tag, value in values:
            add(add(initial, "InitialValue", variable=name), tag, value=value)
    functions, connections = add(root, "Functions"), add(root, "Connections")
    for wire in system.wires:
        if not (wire.source[0] and wire.target[0]):
            continue
        for number, (source, target) in enumerate(system.pairs(wire)):
            ends = [{"simulator": wire.source[0], "name": source}, {"simulator": wire.target[0], "name": target}]
            if wire.transfer.is_plain:
                _connect(connections, "VariableConnection", ("Variable", ends[0]), ("Variable", ends[1]))
                continue
            function = f"{wire.source[0]}.{wire.source[1]} to {wire.target[0]}.{wire.target[1]} {number}"
            add(
                functions,
                "LinearTransformation",
                name=function,
                factor=wire.transfer.factor,
                offset=wire.transfer.offset,
            )
            signals = [{"function": function, "name": name} for name in ("in", "out")]
            _connect(connections, "SignalConnection", ("Variable", ends[0]), ("Signal", signals[0]))
            _connect(connections, "SignalConnection", ("Signal", signals[1]), ("Variable", ends[1]))
    if not len(functions):
        root.remove(functions)
    return to_bytes(root)


def _connect(parent: ET.Element, tag: str, *ends: tuple[str, dict[str, str]]) -> None:
    connection = add(parent, tag)
    for kind, attributes in ends:
        ET.SubElement(connection, kind, attributes)


def _values(part: Part) -> Iterator[tuple[str, str, Any]]:
    """Scalar, type and value of the parameters but for enumerations, which libcosim does not know."""
    for name, value in part.values.items():
        kind = part.variable(name).type
        for element, number in zip(part.scalars(name), value.ravel().tolist(), strict=True):
            if kind != "Enumeration":
                yield element, kind, number


_DESCRIPTION = "modelDescription.xml"


def _write_started(part: Part, out: Path, *, enumerations: bool = True) -> None:
    """Write the part's FMU with its values as start values; everything else in it stays as it is.

    enumerations: False declares them as integers, which FMI 2 sets by the same calls, for tools that know none.
    """
    values = {
        element: str(number).lower()
        for name, value in part.values.items()
        for element, number in zip(part.scalars(name), value.ravel().tolist(), strict=True)
    }
    with replaced(out) as partial, zipfile.ZipFile(part.file) as read, zipfile.ZipFile(partial, "w") as archive:
        for member in read.infolist():
            content = read.read(member)
            if member.filename == _DESCRIPTION:
                content = _begun(content, values, enumerations)
            archive.writestr(member, content)


def _begun(description: bytes, values: dict[str, str], enumerations: bool) -> bytes:
    root = ET.fromstring(description)
    for variable in root.iterfind("ModelVariables/ScalarVariable"):
        if variable.get("name") in values:
            variable[0].set("start", values[variable.get("name", "")])
        if not enumerations and variable[0].tag == "Enumeration":
            variable[0].tag = "Integer"
            variable[0].attrib.pop("declaredType")  # a type of enumerations
    text: bytes = ET.tostring(root, encoding="UTF-8", xml_declaration=True)
    return text


def write(system: System, to: str, out: Path) -> None:
    """Write the FMUs of a system and, in the same new folder, the files of "osp" or "maestro"; all of them or nothing.

    Raises ScenarioError, FileExistsError if `out` exists.
    """
    if to == "osp":
        texts = {OSP_FILE: osp_structure(system).decode()}
    else:
        texts = {name: json.dumps(table, indent=1) + "\n" for name, table in maestro_tables(system).items()}
    with new_folder(out) as folder:
        for part in system.parts:  # libcosim sets no enumerations
            _write_started(part, folder / f"{part.name}.fmu", enumerations=to != "maestro")
        for name, text in texts.items():
            write_text(folder / name, text)
