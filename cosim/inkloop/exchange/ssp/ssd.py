"""SystemStructure.ssd and its parameter set (.ssv), of SSP 1.0 for FMI 2 and of SSP 2.0 with arrays.

Schemas: https://ssp-standard.org. Both versions share their namespaces.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from inkloop import __version__
from inkloop.exchange.ssp import omsimulator
from inkloop.exchange.ssp.system import Part, System
from inkloop.files import replaced
from inkloop.fmu import Variable
from inkloop.fmu_writer.description import add, to_bytes
from inkloop.units import BASE_UNITS, is_known, si_unit

PARAMETERS = "resources/parameters.ssv"
NAMESPACE = "http://ssp-standard.org/SSP1/SystemStructure"
_TYPES = {"Float64": "Real", "Int32": "Integer"}
"""Types of FMI 3 that SSP 2.0 also has under their names of SSP 1.0, which more tools read."""


def description(system: System, version: str) -> bytes:
    """SystemStructure.ssd."""
    root = _root("ssd", "SystemStructureDescription", system, version)
    notes = [f"Made for communication steps of {system.step_s} s.", *(f"{note}." for note in system.notes())]
    top = add(root, "ssd:System", name="system", description=" ".join(notes))
    outside = list(_outside_connectors(system))
    if outside:
        connectors = add(top, "ssd:Connectors")
        for name, kind, part, port in outside:
            _add_connector(connectors, name, kind, part, part.variable(port), port)
    bindings = add(top, "ssd:ParameterBindings")
    add(bindings, "ssd:ParameterBinding", source=PARAMETERS)
    elements = add(top, "ssd:Elements")
    for part in system.parts:
        _add_component(elements, system, part)
    if system.wires:
        connections = add(top, "ssd:Connections")
        for element in _connections(system):
            connections.append(element)
    top.append(omsimulator.settings(system.step_s))
    _add_definitions(root, "ssd", ((part, port) for part in system.parts for port in _connected(system, part)))
    add(root, "ssd:DefaultExperiment", startTime=0.0, stopTime=system.stop_s)
    return to_bytes(root)


def parameters(system: System, version: str) -> bytes:
    """The parameter set: values that differ from the FMUs' start values, as "part.parameter"."""
    root = _root("ssv", "ParameterSet", system, version)
    entries = add(root, "ssv:Parameters")
    given = [(part, part.variable(name), value) for part in system.parts for name, value in part.values.items()]
    for part, variable, value in given:
        texts = [_text(variable, each) for each in value.ravel().tolist()]
        if variable.elements:
            for element, text in zip(variable.elements, texts, strict=True):
                entry = add(entries, "ssv:Parameter", name=f"{part.name}.{element}")
                _add_type(entry, "ssv", part, variable, value=text)
        else:
            entry = add(entries, "ssv:Parameter", name=f"{part.name}.{variable.name}")
            is_list = bool(variable.items) and value.ndim > 0
            typed = _add_type(entry, "ssv", part, variable, value=None if is_list else " ".join(texts))
            for text in texts if is_list else ():
                add(typed, "ssv:Value", value=text)
            for size in value.shape:
                add(entry, "ssc:Dimension", size=size)
    _add_definitions(root, "ssv", ((part, variable) for part, variable, _ in given))
    return to_bytes(root)


def _root(prefix: str, tag: str, system: System, version: str) -> ET.Element:
    kind = {"ssd": "Description", "ssv": "ParameterValues"}
    names = {f"xmlns:{short}": NAMESPACE + ending for short, ending in (("ssc", "Common"), (prefix, kind[prefix]))}
    named = {"version": version, "name": system.name, "description": system.title}
    return ET.Element(f"{prefix}:{tag}", {**names, **named, "generationTool": f"inkloop {__version__}"})


def _add_component(elements: ET.Element, system: System, part: Part) -> None:
    component = add(
        elements,
        "ssd:Component",
        name=part.name,
        type="application/x-fmu-sharedlibrary",
        source=f"resources/{part.name}.fmu",
        implementation="CoSimulation",
    )
    ports = list(_connected(system, part))
    if ports:
        connectors = add(component, "ssd:Connectors")
        for variable in ports:
            for name in part.scalars(variable.name):
                _add_connector(connectors, name, variable.causality, part, variable, variable.name)


def _connected(system: System, part: Part) -> Iterator[Variable]:
    """All outputs, but of the inputs only those with a wire: some tools set every connector, an open one to 0."""
    wired = {wire.target for wire in system.wires}
    for variable in part.description.variables.values():
        if variable.causality == "output" or (variable.causality == "input" and (part.name, variable.name) in wired):
            yield variable


def _outside_connectors(system: System) -> Iterator[tuple[str, str, Part, str]]:
    """Name and kind of each connector of the system itself, and the port that it is connected to."""
    seen = set()
    for wire in system.wires:
        for inner, outer, kind in ((wire.target, wire.source, "input"), (wire.source, wire.target, "output")):
            if outer[0]:
                continue
            part = system.part(inner[0])
            for names in system.pairs(wire):
                name = names[0] if kind == "input" else names[1]
                if name not in seen:
                    seen.add(name)
                    yield name, kind, part, inner[1]


def _connections(system: System) -> Iterator[ET.Element]:
    for wire in system.wires:
        for source, target in system.pairs(wire):
            ends = {
                "startElement": wire.source[0],
                "startConnector": source,
                "endElement": wire.target[0],
                "endConnector": target,
            }
            element = ET.Element("ssd:Connection", {key: end for key, end in ends.items() if end})
            if wire.gain != 1.0 or wire.offset != 0.0:
                add(element, "ssc:LinearTransformation", factor=wire.gain, offset=wire.offset)
            yield element


def _add_connector(parent: ET.Element, name: str, kind: str, part: Part, variable: Variable, port: str) -> None:
    connector = add(parent, "ssd:Connector", name=name, kind=kind)
    _add_type(connector, "ssc", part, variable)
    for size in part.shape(port):
        add(connector, "ssc:Dimension", size=size)


def _add_type(parent: ET.Element, prefix: str, part: Part, variable: Variable, **value: str | None) -> ET.Element:
    """The type of a connector, or that of a parameter with its value."""
    kind = _TYPES.get(variable.type, variable.type)
    unit = variable.unit if kind in ("Real", "Float32") and is_known(variable.unit) else None
    name = _enumeration(part, variable) if variable.items else None
    return add(parent, f"{prefix}:{kind}", **value, unit=unit, name=name)


def _enumeration(part: Part, variable: Variable) -> str:
    """The name of the enumeration of a variable: types of two FMUs may share theirs."""
    return f"{part.name}.{variable.name}"


def _text(variable: Variable, value: float | bool) -> str:
    if variable.items:
        return next(name for name, number in variable.items.items() if number == value)
    if np.dtype(variable.dtype).kind == "b":
        return "true" if value else "false"
    return repr(value)


def _add_definitions(root: ET.Element, prefix: str, used: Iterable[tuple[Part, Variable]]) -> None:
    """The enumerations and the units of variables."""
    variables = list(used)
    coded = {_enumeration(part, each): each.items for part, each in variables if each.items}
    enumerations = add(root, f"{prefix}:Enumerations") if coded else root
    for name, items in coded.items():
        enumeration = add(enumerations, "ssc:Enumeration", name=name)
        for item, number in items.items():
            add(enumeration, "ssc:Item", name=item, value=number)
    known = sorted({each.unit for _, each in variables if is_known(each.unit)})
    units = add(root, f"{prefix}:Units") if known else root
    for unit in known:
        si, factor = si_unit(unit)
        add(add(units, "ssc:Unit", name=unit), "ssc:BaseUnit", **BASE_UNITS[si], factor=factor)


STRUCTURE = "SystemStructure.ssd"
SCENARIO = "extra/org.inkloop/scenario.toml"
"""Path of the embedded scenario, with the content that an .ssd cannot express: the part, the run, components
outside."""


def write(system: System, version: str, out: Path) -> None:
    """Write the system to `out`, whole or not at all; version: of SSP, "1.0" or "2.0"."""
    out.parent.mkdir(parents=True, exist_ok=True)
    with replaced(out) as partial, zipfile.ZipFile(partial, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(STRUCTURE, description(system, version))
        archive.writestr(PARAMETERS, parameters(system, version))
        archive.writestr(SCENARIO, system.scenario_text)
        for part in system.parts:
            archive.write(part.file, f"resources/{part.name}.fmu")
