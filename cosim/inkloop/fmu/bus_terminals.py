"""Bus terminals of FMUs (FMI-LS-BUS, Network Abstraction): those that the master can serve, and Event Mode for them."""

from __future__ import annotations

import ctypes
import math
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple
from xml.etree import ElementTree

from inkloop.errors import ComponentError
from inkloop.fmu_writer.documentation import BUS_TERMINAL, MANIFEST
from inkloop.limits import parsed_xml

TERMINALS = "terminalsAndIcons/terminalsAndIcons.xml"
TRIGGERED, COUNTDOWN = "triggered", "countdown"
_CAN = "application/org.fmi-standard.fmi-ls-bus.can;"
INSTANTS_MAX = 1000
"""Instants of Event Mode at one time; an FMU that asks for more never comes to an end."""
_CHANGED = 2
_ROUNDING_S = 1e-9
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
        if element.get("terminalKind") != BUS_TERMINAL[0]:
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


class Events:
    """Event Mode of an FMU with clocks, which begins with the end of initialisation; call: `Binding.call`."""

    def __init__(self, call: Callable[..., Any], buses: Sequence[BusTerminal]) -> None:
        self._call = call
        self._buses = buses
        self._due = {bus.tx_clock: math.inf for bus in buses if bus.tx_interval == COUNTDOWN}
        self._is_inside = True

    def is_due(self, time: float) -> bool:
        """Whether a countdown has ended by `time` [s]."""
        return any(due <= time + _ROUNDING_S for due in self._due.values())

    def handle(self, time: float, received: Mapping[str, bytes]) -> dict[str, bytes]:
        """One stay in Event Mode at `time` [s]: operations for buses by name; returns what the buses send."""
        if not self._is_inside:
            self._call("enterEventMode")
        sent = {bus.name: b"" for bus in self._buses}
        for _ in range(INSTANTS_MAX):
            counted = self._set(time, received)  # all inputs come before the first output
            for bus in self._buses:
                is_countdown = bus.tx_interval == COUNTDOWN
                ticks = bus.tx_clock in counted if is_countdown else self._call("getClock", [bus.tx_clock])[0]
                if ticks:
                    (content,) = self._call("getBinary", [bus.tx_data])
                    sent[bus.name] += content or b""
            received = {}
            (again, *_) = self._call("updateDiscreteStates")
            self._count_down(time)
            if not again and not self.is_due(time):
                self._call("enterStepMode")
                self._is_inside = False
                return {name: content for name, content in sent.items() if content}
        raise ComponentError(f"Event Mode at {time:g} s does not end: {INSTANTS_MAX} instants")

    def _set(self, time: float, received: Mapping[str, bytes]) -> set[int]:
        """Set clocks and operations of an instant; the countdown clocks that tick."""
        counted = {clock for clock, due in self._due.items() if due <= time + _ROUNDING_S}
        given = {bus: received[bus.name] for bus in self._buses if received.get(bus.name)}
        clocks = [*counted, *(bus.rx_clock for bus in given)]
        if clocks:
            self._call("setClock", clocks, [True] * len(clocks))
        for bus, content in given.items():
            self._call("setBinary", [bus.rx_data], [content])
        self._due |= dict.fromkeys(counted, math.inf)
        return counted

    def _count_down(self, time: float) -> None:
        for clock in self._due:
            reference = (ctypes.c_uint * 1)(clock)
            interval, qualifier = (ctypes.c_double * 1)(), (ctypes.c_int * 1)()
            self._call("getIntervalDecimal", reference, interval, qualifier)
            if qualifier[0] == _CHANGED:
                self._due[clock] = time + interval[0]
