"""Read a mapping file and check it against its DBC: all errors at once, each with its place."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from cantools.database.can import Message
from pydantic import ValidationError
from pydantic_core import ErrorDetails

from inkloop.component import Job
from inkloop.errors import ScenarioError, nearest
from inkloop.files import TomlError, read_toml_text, toml_tables
from inkloop_hardware.errors import FrameError
from inkloop_hardware.mapped.mapped_bytes import hexadecimal, number
from inkloop_hardware.mapped.mapping_tables import (
    METRES,
    SECONDS,
    SECTIONS,
    STEPS,
    Download,
    MappingFile,
    Memory,
    Peer,
    Read,
    RoutineStep,
    Send,
    Step,
    Upload,
    Value,
    Wait,
)
from inkloop_hardware.protocol.codec import COUNTERS, EXTENDED, FD_LENGTHS, Codec, id_of, id_text, is_fd

STANDARD_IDS, EXTENDED_IDS = 1 << 11, 1 << 29


@dataclass(frozen=True)
class RigMapping:
    """A valid mapping of a file for a job.

    ids: of the requests to each peer and of its answers; needs_fd: it has frames of CAN FD.
    """

    path: Path
    job: Job
    tables: MappingFile
    codec: Codec
    ids: Mapping[str, tuple[int, int]]
    needs_fd: bool


def load(path: Path, job: Job) -> RigMapping:
    """The mapping for a job. Raises ScenarioError with every error of the file."""
    raw: dict[str, Any] = {}
    try:
        raw = toml_tables(read_toml_text(path))
        tables = MappingFile.model_validate(raw)
    except OSError as error:
        raise ScenarioError(str(path), [f"cannot be read: {error.strerror}"]) from error
    except TomlError as error:
        raise ScenarioError(str(path), [str(error)]) from error
    except ValidationError as error:
        errors = [_sentence(detail) for detail in error.errors()]
        raise ScenarioError(str(path), [*errors, *_missing_dbc(path.parent, raw.get("dbc"))]) from error
    try:
        codec = Codec(path.parent / tables.dbc, strict=tables.strict)
    except FrameError as error:
        raise ScenarioError(str(path), [f"dbc: {error}"]) from error
    check = _Check(tables, codec, {"job": 1, "layer": 1, "nx": job.nx, "ny": job.ny})
    if check.errors:
        raise ScenarioError(str(path), check.errors)
    return RigMapping(path, job, tables, codec, check.ids, check.needs_fd)


def factor(source: str, target: str) -> float | None:
    """Factor from one unit to another, None if they are not known as units of one quantity."""
    if source == target:
        return 1.0
    for units in (METRES, SECONDS):
        if source in units and target in units:
            return units[source] / units[target]
    return None


def resolved(value: Value, fields: Mapping[str, int]) -> float | str:
    """A number or a name; a template is filled in. Raises ValueError for an invalid template."""
    return number(value, fields) if isinstance(value, str) and "{" in value else value


class _Check:
    """Collects the errors of tables whose keys are valid one by one."""

    def __init__(self, tables: MappingFile, codec: Codec, fields: Mapping[str, int]) -> None:
        self.errors: list[str] = []
        self.needs_fd = any(peer.fd for peer in tables.peers.values())
        self._tables, self._codec, self._fields = tables, codec, fields
        self.ids = {name: self._ids(f"peers.{name}", peer) for name, peer in tables.peers.items()}
        for name, table in (("pattern", tables.pattern), ("map", tables.map)):
            if table is not None:
                self._try(f"{name}.header", hexadecimal, table.header)
        if tables.map is not None and tables.map.unit not in METRES:
            self.errors.append(f"map.unit is {tables.map.unit!r}; expected one of {', '.join(METRES)}")
        for section in SECTIONS:
            steps: tuple[Step, ...] = getattr(tables, section)
            for place, step in enumerate(steps, 1):
                self._step(f"{section} step {place} ({step.do})", step)
        self._outputs()
        self._needs()

    def _needs(self) -> None:
        """Check that the ports of the contract have their steps and tables."""
        tables = self._tables
        downloads = _count(tables.printer, Download)
        uploads = _count(tables.profiler, Upload)
        if not tables.printer and not tables.profiler:
            self.errors.append("binds no port; add [[printer]] steps of a layer, [[profiler]] steps of a scan, or both")
        if tables.printer and not downloads:
            self.errors.append('printer has no step do = "download": the input pattern goes nowhere; add one')
        if tables.profiler and uploads != 1:
            self.errors.append(f'profiler has {uploads} steps do = "upload"; measured_height needs exactly one')
        if downloads + _count(tables.start, Download) and tables.pattern is None:
            self.errors.append("pattern is missing; add the table [pattern], which defines the bytes of the cells")
        if uploads and tables.map is None:
            self.errors.append("map is missing; add the table [map], which defines the heights of the bytes")
        others = (*tables.start, *tables.stop)
        if _count((*others, *tables.profiler), Download) + _count((*others, *tables.printer), Upload):
            self.errors.append("a download is a step of the printer, an upload one of the profiler; move it there")

    def _step(self, place: str, step: Step) -> None:
        if step.enables and not self._tables.heartbeat:
            self.errors.append(f"{place}: enables are of the heartbeat; write heartbeat = true, or leave them out")
        if isinstance(step, Memory | RoutineStep | Read) and step.peer not in self._tables.peers:
            self.errors.append(f"{place}: peer is {step.peer!r}; {_nearest(step.peer, self._tables.peers)}")
        if isinstance(step, Memory):
            self._try(f"{place}: address", partial(_address, 256**step.address_bytes), step.address)
        elif isinstance(step, RoutineStep):
            self._try(f"{place}: option", hexadecimal, step.option)
            self._try(f"{place}: answer", hexadecimal, step.answer)
        elif isinstance(step, Read):
            self._try(f"{place}: expected", number, step.expected)
        elif isinstance(step, Send) and self._message(place, step.message):
            self._encode(place, step)
        elif isinstance(step, Wait):
            self._signal(place, step.message, step.signal, expected=step.expected, unless=step.unless)

    def _encode(self, place: str, step: Send) -> None:
        try:
            values = {name: resolved(value, self._fields) for name, value in step.signals.items()}
            supervised = self._codec.data_id(step.message) is not None
            self._codec.encode(step.message, values, COUNTERS - 1 if supervised else None)
        except (FrameError, ValueError) as error:
            self.errors.append(f"{place}: {error}")

    def _signal(self, place: str, message: str, signal: str, **values: Value | None) -> str | None:
        """Unit of a signal in the DBC, None for an unknown signal; values: expected ones by key of the file."""
        found = self._message(place, message)
        if found is None:
            return None
        if signal not in self._signals(found):
            self.errors.append(f"{place}: signal is {signal!r}; {_nearest(signal, self._signals(found))}")
            return None
        described = found.get_signal_by_name(signal)
        names = [str(choice) for choice in (described.choices or {}).values()]
        for key, value in values.items():
            if isinstance(value, str) and "{" in value:
                self._try(f"{place}: {key}", number, value)
            elif isinstance(value, str) and value not in names:
                self.errors.append(f"{place}: {key} is {value!r}; {_nearest(value, names)}")
        return described.unit or "1"

    def _message(self, place: str, name: str) -> Message | None:
        known = [message.name for message in self._codec.database.messages]
        if name not in known:
            self.errors.append(f"{place}: message is {name!r}; {_nearest(name, known)}")
            return None
        found = self._codec.message(name)
        if found.length not in FD_LENGTHS:
            lengths = ", ".join(map(str, FD_LENGTHS[8:-1]))
            self.errors.append(
                f"{place}: {name} has {found.length} bytes; a frame has up to {lengths} or {FD_LENGTHS[-1]}"
            )
            return None
        self.needs_fd = self.needs_fd or is_fd(found)
        return found

    def _ids(self, place: str, peer: Peer) -> tuple[int, int]:
        request, answer = self._id(f"{place}.request", peer.request), self._id(f"{place}.answer", peer.answer)
        if (request ^ answer) & EXTENDED:
            self.errors.append(f"{place}: {id_text(request)} and {id_text(answer)}; expected two 11-bit or 29-bit ids")
        return request, answer

    def _id(self, place: str, given: int | str) -> int:
        if isinstance(given, str):
            found = self._message(place, given)
            return id_of(found) if found else 0
        if not 0 <= given < EXTENDED_IDS:
            self.errors.append(f"{place} is 0x{given:X}; expected an id of 11 or 29 bits, 0 to 0x{EXTENDED_IDS - 1:X}")
        return given | EXTENDED * (given >= STANDARD_IDS)

    def _outputs(self) -> None:
        for name, output in self._tables.outputs.items():
            unit = self._signal(f"outputs.{name}", output.message, output.signal)
            if unit is not None and output.unit is not None and factor(unit, output.unit) is None:
                self.errors.append(
                    f"outputs.{name}: unit is {output.unit!r}, to which the [{unit}] of {output.signal} does not "
                    "convert; name a unit of the same quantity"
                )

    def _try(self, place: str, read: Callable[..., object], template: int | str) -> None:
        try:
            read(template, self._fields)
        except ValueError as error:
            self.errors.append(f"{place} is {error}")

    @staticmethod
    def _signals(message: Message) -> list[str]:
        return [signal.name for signal in message.signals]


def _address(end: int, template: int | str, fields: Mapping[str, int]) -> int:
    found = number(template, fields)
    if not 0 <= found < end:
        raise ValueError(f"0x{found:X}; expected 0 to 0x{end - 1:X} by address_bytes")
    return found


def _count(steps: Iterable[Step], kind: type) -> int:
    return sum(isinstance(step, kind) for step in steps)


def _nearest(found: str, known: Iterable[str]) -> str:
    names = sorted(known)
    close = difflib.get_close_matches(found, names, 2)
    if close:
        return f"did you mean {' or '.join(close)}?"
    return f"known: {', '.join(names)}" if names else "there is none"


def _missing_dbc(folder: Path, name: object) -> list[str]:
    """The error of a DBC that is not there, for a file whose other errors keep it from being read."""
    return [f"dbc: {folder / name} is not there"] if isinstance(name, str) and not (folder / name).is_file() else []


def _sentence(detail: ErrorDetails) -> str:
    """Message of one error of pydantic."""
    place = ".".join(str(part + 1) if isinstance(part, int) else part for part in detail["loc"])
    if detail["type"] == "missing":
        return f"{place} is missing; add it"
    if detail["type"] == "extra_forbidden":
        return f"{place} is not a key of this table"
    if detail["type"] == "union_tag_invalid":
        return f"{place}.do is {detail['ctx']['tag']!r}; {nearest(str(detail['ctx']['tag']), STEPS)}"
    if detail["type"] == "union_tag_not_found":
        return f"{place}.do is missing; add one of {', '.join(STEPS)}"
    expected = detail["msg"].replace("Input should be", "expected", 1)
    return f"{place} is {detail['input']!r}; {expected}"
