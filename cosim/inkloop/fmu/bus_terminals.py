"""Bus terminals of FMUs (FMI-LS-BUS, Network Abstraction): those that the master can serve, and why not the others."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple
from xml.etree import ElementTree

from inkloop.limits import parsed_xml

TERMINALS = "terminalsAndIcons/terminalsAndIcons.xml"
MANIFEST = "extra/org.fmi-standard.fmi-ls-bus/fmi-ls-manifest.xml"
TRIGGERED, COUNTDOWN = "triggered", "countdown"
_KIND = "org.fmi-ls-bus.network-terminal"
_CAN = "application/org.fmi-standard.fmi-ls-bus.can;"
_MEMBERS = ("Rx_Data", "Rx_Clock", "Tx_Data", "Tx_Clock")


class BusTerminal(NamedTuple):
    """A bus terminal of an FMU: value references of its members, and the interval of the clock that it sends with."""

    name: str
    rx_data: int
    rx_clock: int
    tx_data: int
    tx_clock: int
    tx_interval: str


@dataclass(frozen=True)
class MemberVariable:
    """A variable of a terminal; interval: of a clock, mime_type: of a binary."""

    reference: int
    kind: str
    interval: str | None = None
    mime_type: str | None = None


def read_buses(archive: zipfile.ZipFile, model: Any) -> dict[str, Any]:
    """Fields of the description: `buses`, `unserved`, `is_bus_simulation`. model: the FMU as FMPy has read it."""
    names = archive.namelist()
    if model.fmiVersion[:1] != "3" or TERMINALS not in names:
        return {}
    types = _mime_types(archive)
    members = {
        v.name: MemberVariable(v.valueReference, v.type, v.intervalVariability, types.get(v.name))
        for v in model.modelVariables
    }
    buses, unserved = bus_terminals(archive.read(TERMINALS), members)
    manifest = parsed_xml(archive.read(MANIFEST)) if MANIFEST in names else ElementTree.Element("none")
    return {
        "buses": tuple(buses),
        "unserved": unserved,
        "is_bus_simulation": manifest.get("isBusSimulationFMU") in ("true", "1"),
    }


def _mime_types(archive: zipfile.ZipFile) -> dict[str, str]:
    """Of the binaries, which FMPy 0.3.32 does not read."""
    with archive.open("modelDescription.xml") as file:
        found = (element for _, element in ElementTree.iterparse(file) if element.tag == "Binary")
        return {element.get("name", ""): element.get("mimeType", "") for element in found}


def bus_terminals(xml: bytes, variables: Mapping[str, MemberVariable]) -> tuple[list[BusTerminal], dict[str, str]]:
    """Bus terminals in terminalsAndIcons.xml that the master can serve; those that it cannot, and why.

    Raises XmlError.
    """
    served: list[BusTerminal] = []
    unserved: dict[str, str] = {}
    for element in parsed_xml(xml).iter("Terminal"):
        if element.get("terminalKind") != _KIND:
            continue
        name = element.get("name", "")
        named = {m.get("memberName"): m.get("variableName", "") for m in element.findall("TerminalMemberVariable")}
        members = {member: variables[named[member]] for member in _MEMBERS if named.get(member) in variables}
        if reason := _obstacle(members):
            unserved[name] = reason
        else:
            rx_data, rx_clock, tx_data, tx_clock = (members[member].reference for member in _MEMBERS)
            interval = members["Tx_Clock"].interval or ""
            served.append(BusTerminal(name, rx_data, rx_clock, tx_data, tx_clock, interval))
    return served, unserved


def _obstacle(members: Mapping[str, MemberVariable]) -> str | None:
    """The reason why the master cannot serve a terminal with these members."""
    if lacking := [member for member in _MEMBERS if member not in members]:
        return f"it has no {', '.join(lacking)}"
    for member in _MEMBERS:
        kind = "Binary" if member.endswith("Data") else "Clock"
        if members[member].kind != kind:
            return f"its {member} is a {members[member].kind}; expected a {kind}"
    for member in ("Rx_Data", "Tx_Data"):
        if not (members[member].mime_type or "").startswith(_CAN):
            return f"its {member} is of type {members[member].mime_type}; this master knows the bus CAN"
    if members["Rx_Clock"].interval != TRIGGERED:
        return f"its Rx_Clock is {members['Rx_Clock'].interval}; expected {TRIGGERED}"
    if members["Tx_Clock"].interval not in (TRIGGERED, COUNTDOWN):
        return f"its Tx_Clock is {members['Tx_Clock'].interval}; this master serves {TRIGGERED} and {COUNTDOWN} ones"
    return None
