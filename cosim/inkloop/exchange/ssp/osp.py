"""OspSystemStructure.xml, the system file of libcosim, and its limits for FMI 2.

https://open-simulation-platform.github.io/libcosim/configuration
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from typing import Any

from inkloop.exchange.ssp.system import Part, System
from inkloop.fmu_writer.description import add, to_bytes

FILE = "OspSystemStructure.xml"
_NAMESPACE = "http://opensimulationplatform.com/MSMI/OSPSystemStructure"


def structure(system: System) -> bytes:
    """The file; FMUs are in the same folder. Wires to the outside are omitted: these inputs are overridden there."""
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
