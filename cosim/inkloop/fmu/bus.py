"""Buses of FMUs by FMI-LS-BUS (Network Abstraction, CAN): terminals, and the operations in their binaries.

An operation is its code and total length, 32 bits each, then its arguments; numbers are little-endian.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple
from xml.etree import ElementTree

TERMINALS = "terminalsAndIcons/terminalsAndIcons.xml"
_KIND = "org.fmi-ls-bus.network-terminal"
_CAN = "application/org.fmi-standard.fmi-ls-bus.can;"
_MEMBERS = ("Rx_Data", "Rx_Clock", "Tx_Data", "Tx_Clock")
TRIGGERED, COUNTDOWN = "triggered", "countdown"
FORMAT_ERROR, TRANSMIT, CONFIRM, CONFIGURATION, STATUS, WAKEUP = 0x01, 0x10, 0x20, 0x40, 0x41, 0x42
_SILENT = (FORMAT_ERROR, CONFIRM, CONFIGURATION, STATUS, WAKEUP)
_HEAD = struct.Struct("<II")
_FRAME = struct.Struct("<IBBH")


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
    """What a terminal needs to know of a variable; interval: of a clock, mime_type: of a binary."""

    reference: int
    kind: str
    interval: str | None = None
    mime_type: str | None = None


class BusFrame(NamedTuple):
    """A frame of classic CAN."""

    identifier: int
    data: bytes
    is_extended: bool = False
    is_remote: bool = False


class Operation(NamedTuple):
    """An operation of a bus, whole."""

    code: int
    content: bytes

    @property
    def frame(self) -> BusFrame | None:
        """The frame of a CAN Transmit, None for another or a malformed operation."""
        if self.code != TRANSMIT or len(self.content) < _HEAD.size + _FRAME.size:
            return None
        identifier, extended, remote, length = _FRAME.unpack_from(self.content, _HEAD.size)
        data = self.content[_HEAD.size + _FRAME.size :]
        return BusFrame(identifier, data, bool(extended), bool(remote)) if len(data) == length <= 8 else None

    @property
    def answer(self) -> bytes:
        """What an ideal bus answers to the sender: Confirm to a frame, Format Error to what it does not know."""
        if frame := self.frame:
            return operation(CONFIRM, struct.pack("<I", frame.identifier))
        return b"" if self.code in _SILENT else format_error(self.content)


def operation(code: int, arguments: bytes) -> bytes:
    """The bytes of an operation."""
    return _HEAD.pack(code, _HEAD.size + len(arguments)) + arguments


def transmit(frame: BusFrame) -> bytes:
    """A CAN Transmit."""
    head = _FRAME.pack(frame.identifier, frame.is_extended, frame.is_remote, len(frame.data))
    return operation(TRANSMIT, head + frame.data)


def format_error(wrong: bytes) -> bytes:
    """A Format Error about an operation that cannot be read."""
    quoted = wrong[:0xFFFF]
    return operation(FORMAT_ERROR, struct.pack("<H", len(quoted)) + quoted)


def operations(content: bytes) -> Iterator[Operation]:
    """The operations in a binary. One whose length cannot be is the last, with code 0 and all that is left."""
    while content:
        code, length = _HEAD.unpack_from(content) if len(content) >= _HEAD.size else (0, 0)
        if not _HEAD.size <= length <= len(content):
            code, length = 0, len(content)
        yield Operation(code, content[:length])
        content = content[length:]


def bus_terminals(xml: bytes, variables: Mapping[str, MemberVariable]) -> tuple[list[BusTerminal], dict[str, str]]:
    """Bus terminals in terminalsAndIcons.xml that the master can serve; those that it cannot, and why.

    Raises ElementTree.ParseError.
    """
    served: list[BusTerminal] = []
    unserved: dict[str, str] = {}
    for element in ElementTree.fromstring(xml).iter("Terminal"):
        if element.get("terminalKind") != _KIND:
            continue
        name = element.get("name", "")
        named = {m.get("memberName"): m.get("variableName", "") for m in element.findall("TerminalMemberVariable")}
        members = {member: variables[named[member]] for member in _MEMBERS if named.get(member) in variables}
        if reason := _obstacle(members):
            unserved[name] = reason
        else:
            references = (members[member].reference for member in _MEMBERS)
            served.append(BusTerminal(name, *references, members["Tx_Clock"].interval or ""))
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
