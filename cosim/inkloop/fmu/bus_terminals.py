"""Bus terminals of FMUs (FMI-LS-BUS, Network Abstraction): those that the master can serve, and Event Mode for them."""

from __future__ import annotations

import ctypes
import math
import re
import zipfile
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple
from xml.etree import ElementTree

from inkloop.errors import ComponentError
from inkloop.fmu_writer.documentation import BUS_TERMINAL, MANIFEST
from inkloop.limits import parsed_xml

TERMINALS = "terminalsAndIcons/terminalsAndIcons.xml"
TRIGGERED, COUNTDOWN = "triggered", "countdown"
_CAN = re.compile(r'application/org\.fmi-standard\.fmi-ls-bus\.can; *version="1\.')
INSTANTS_MAX = 1000
"""Instants of Event Mode at one time; an FMU that asks for more never comes to an end."""
_CHANGED = 2
_ROUNDING_S = 1e-9
_MEMBERS = {
    "Rx_Data": "input, Binary",
    "Rx_Clock": "input, Clock",
    "Tx_Data": "output, Binary",
    "Tx_Clock": "output, Clock",
}
_INTERVALS = {"Rx": (TRIGGERED,), "Tx": (TRIGGERED, COUNTDOWN)}


class BusTerminal(NamedTuple):
    """A bus terminal of an FMU: value references of its members, and the interval of the clock that it sends with."""

    name: str
    rx_data: int
    rx_clock: int
    tx_data: int
    tx_clock: int
    tx_interval: str

    @property
    def references(self) -> tuple[int, ...]:
        """Value references of its four members."""
        return self[1:5]


def read_buses(archive: zipfile.ZipFile, model: Any) -> dict[str, Any]:
    """Fields of the description: `buses`, `unserved`, `is_bus_simulation`. model: the FMU as FMPy has read it."""
    names = archive.namelist()
    if model.fmiVersion[:1] != "3" or TERMINALS not in names:
        return {}
    described = parsed_xml(archive.read("modelDescription.xml")).find("ModelVariables")
    variables = {v.get("name", ""): v for v in (described if described is not None else ())}
    buses, unserved = bus_terminals(archive.read(TERMINALS), variables)
    if not model.coSimulation.hasEventMode:
        unserved |= dict.fromkeys((bus.name for bus in buses), "the FMU has no Event Mode (hasEventMode)")
    manifest = parsed_xml(archive.read(MANIFEST)) if MANIFEST in names else ElementTree.Element("none")
    return {
        "buses": tuple(bus for bus in buses if bus.name not in unserved),
        "unserved": unserved,
        "is_bus_simulation": manifest.get("isBusSimulationFMU") in ("true", "1"),
    }


def bus_terminals(xml: bytes, variables: Mapping[str, ElementTree.Element]) -> tuple[list[BusTerminal], dict[str, str]]:
    """Bus terminals in terminalsAndIcons.xml that the master can serve; those that it cannot, and why.

    variables: of modelDescription.xml, by name. Raises XmlError.
    """
    served: list[BusTerminal] = []
    unserved: dict[str, str] = {}
    for element in parsed_xml(xml).iter("Terminal"):
        if element.get("terminalKind") != BUS_TERMINAL[0]:
            continue
        name = element.get("name", "")
        listed = element.findall("TerminalMemberVariable")
        named = [(m.get("memberName", ""), m.get("variableName", "")) for m in listed]
        if name in ("", *unserved, *(bus.name for bus in served)):
            unserved[name] = "its name is that of another bus" if name else "it has no name"
        elif reason := _obstacle(named, variables):
            unserved[name] = reason
        else:
            found = {member: variables[variable] for member, variable in named if member in _MEMBERS}
            rx_data, rx_clock, tx_data, tx_clock = (int(found[each].get("valueReference", "")) for each in _MEMBERS)
            interval = found["Tx_Clock"].get("intervalVariability", "")
            served.append(BusTerminal(name, rx_data, rx_clock, tx_data, tx_clock, interval))
    return served, unserved


def _obstacle(named: Sequence[tuple[str, str]], variables: Mapping[str, ElementTree.Element]) -> str | None:
    """The reason why the master cannot serve a terminal with these pairs of member and variable."""
    members = [member for member, _ in named]
    if wrong := [member for member in _MEMBERS if members.count(member) != 1]:
        return f"it has {members.count(wrong[0]) or 'no'} {', '.join(wrong)}"
    found = {member: variables[variable] for member, variable in named if variable in variables}
    for member, expected in _MEMBERS.items():
        if member not in found:
            return f"its {member} names {dict(named)[member]}, which is no variable of the FMU"
        variable = found[member]
        if variable.get("intervalVariability", TRIGGERED) != TRIGGERED:
            expected = "input, Clock"  # the importer ticks clocks that depend on time
        kind = f"{variable.get('causality', 'local')}, {variable.tag}"
        if kind != expected:
            return f"its {member} is ({kind}); expected ({expected})"
    for way in ("Rx", "Tx"):
        data, clock = found[f"{way}_Data"], found[f"{way}_Clock"]
        if not _CAN.match(mime_type := data.get("mimeType", "")):
            return f"its {way}_Data is of MIME type {mime_type or 'unknown'}; this master knows the bus CAN, version 1"
        if clock.get("valueReference") not in data.get("clocks", "").split():
            return f"its {way}_Data does not name its {way}_Clock as its clock"
        interval, known = clock.get("intervalVariability"), _INTERVALS[way]
        if interval not in known:
            return f"its {way}_Clock is {interval}; this master serves {' and '.join(known)} ones"
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
