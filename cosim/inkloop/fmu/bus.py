"""The bus CAN by FMI-LS-BUS (Network Abstraction): its operations, as binaries of FMUs hold them, and its partners.

An operation is its code and total length, 32 bits each, then its arguments; numbers are little-endian.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from inkloop.component import Values
from inkloop.errors import ComponentError, FmuError
from inkloop.fmu.component import FmuComponent

FORMAT_ERROR, TRANSMIT, CONFIRM, CONFIGURATION, STATUS, WAKEUP = 0x01, 0x10, 0x20, 0x40, 0x41, 0x42
_KNOWN = (FORMAT_ERROR, CONFIRM, 0x30, 0x31, CONFIGURATION, STATUS, WAKEUP)
"""Operations besides frames; 0x30 Arbitration Lost, 0x31 Bus Error."""
_HEAD = struct.Struct("<II")
_FRAME = struct.Struct("<IBBH")
ROUNDS_MAX = 100
"""Answers to answers at one communication point."""
_OF_THE_BUS = (CONFIRM, CONFIGURATION, STATUS)
"""Operations that an ideal bus does not carry to the other node."""


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


class BusEnd(NamedTuple):
    """A bus of a component."""

    component: str
    bus: str

    def __str__(self) -> str:
        """As in a scenario."""
        return f"{self.component}.{self.bus}"


@dataclass(frozen=True)
class BusLink:
    """Two ends of a bus; ideal: both are nodes, and what each sends is carried and confirmed by the master, else one
    is a bus simulation, which does that.
    """

    ends: tuple[BusEnd, BusEnd]
    ideal: bool


class BusLinks:
    """An observer of the master that carries what the components of `links` send, which are FMUs. Raises
    ComponentError.
    """

    def __init__(self, components: Mapping[str, Any], links: Sequence[BusLink]) -> None:
        self._links = links
        self._exchanges: dict[str, Callable[[Mapping[str, bytes]], dict[str, bytes]]] = {
            end.component: components[end.component].exchange for link in links for end in link.ends
        }

    def initialized(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        """At the start."""
        self.carry()

    def stepped(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        """After each step."""
        self.carry()

    def carry(self) -> None:
        """Carry what has been sent, and the answers to it, at the present communication point."""
        given: dict[str, dict[str, bytes]] = {}
        for _ in range(ROUNDS_MAX):
            sent = {name: exchange(given.get(name, {})) for name, exchange in self._exchanges.items()}
            given = self._delivered(sent) if any(sent.values()) else {}
            if not given:
                return
        found = " and ".join(f"{one} and {other}" for one, other in (link.ends for link in self._links))
        raise ComponentError(f"buses of {found}: operations at one time do not end after {ROUNDS_MAX} rounds")

    def _delivered(self, sent: Mapping[str, Mapping[str, bytes]]) -> dict[str, dict[str, bytes]]:
        """Operations for each component on its buses."""
        given: dict[str, dict[str, bytes]] = {}
        for link in self._links:
            for end, other in (link.ends, link.ends[::-1]):
                content = sent[end.component].get(end.bus, b"")
                carried, answers = _through(content) if link.ideal else (content, b"")
                for taker, part in ((other, carried), (end, answers)):
                    if part:
                        buses = given.setdefault(taker.component, {})
                        buses[taker.bus] = buses.get(taker.bus, b"") + part
        return given


def _through(content: bytes) -> tuple[bytes, bytes]:
    """Operations of an ideal bus: those for the other node, and those for the sender."""
    carried, answers = [], []
    for found in operations(content):
        if frame := found.frame:
            answers.append(operation(CONFIRM, struct.pack("<I", frame.identifier)))
        elif found.code not in _KNOWN:  # nor is a frame that cannot be read
            answers.append(format_error(found.content))
            continue
        if found.code not in _OF_THE_BUS:
            carried.append(found.content)
    return b"".join(carried), b"".join(answers)


class BusNode:
    """An FMU with one bus, and its partner there, who steps it: frames in, frames out.

    Starts the FMU; parameters: of the FMU, by name. Raises FmuError, later ComponentError.
    """

    def __init__(self, path: Path | str, parameters: Mapping[str, object]) -> None:
        self._fmu = FmuComponent(path, parameters=parameters)
        about = self._fmu.description
        if len(about.buses) != 1 or about.unserved:
            found = [bus.name for bus in about.buses] + [f"{name}: {why}" for name, why in about.unserved.items()]
            self._fmu.terminate()
            raise FmuError(
                f"{path}: expected an FMU with one CAN bus (FMI-LS-BUS), its buses are {'; '.join(found) or 'none'}"
            )
        ends = BusEnd("fmu", about.buses[0].name), BusEnd("partner", "frames")
        links = [BusLink(ends, ideal=not about.is_bus_simulation)]
        self._links = BusLinks({"fmu": self._fmu, "partner": self}, links)
        self._given, self._taken = b"", list[BusFrame]()
        self._fmu.initialize(0, {})

    def step(self, time_ns: int, step_ns: int, frames: Iterable[tuple[int, bytes, bool, bool]]) -> list[BusFrame]:
        """Give frames, then step; the frames that the FMU has sent. Raises FmuError for what it could not read."""
        self._given = b"".join(transmit(BusFrame(*frame)) for frame in frames)
        if self._given:
            self._links.carry()
        self._fmu.advance(time_ns, step_ns, {})
        self._links.carry()
        taken, self._taken = self._taken, []
        return taken

    def exchange(self, received: Mapping[str, bytes]) -> dict[str, bytes]:
        """Of the partner, as `FmuComponent.exchange`."""
        for found in operations(received.get("frames", b"")):
            if found.code == FORMAT_ERROR:
                raise FmuError(f"the FMU could not read an operation of its partner: {found.content.hex()}")
            if frame := found.frame:
                self._taken.append(frame)
        given, self._given = self._given, b""
        return {"frames": given} if given else {}

    def close(self) -> None:
        """End the FMU."""
        self._fmu.terminate()
