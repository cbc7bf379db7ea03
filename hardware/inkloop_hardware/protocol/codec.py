"""Conversion of physical values to CAN frames and back, by a DBC.

The DBC is the only place of ids, scales, units and limits. A message with the attribute `E2EDataId` is supervised: the
codec fills its signals `Crc8` and `Counter` by AUTOSAR E2E profile 1. They detect damage; they make nothing safe.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import NamedTuple

import cantools
from cantools.database import errors as cantools_errors
from cantools.database.can import Database, Message, Signal
from e2e import p01

from inkloop.files import regular
from inkloop.units import MS_PER_S
from inkloop_hardware.errors import FrameError

BENCH_DBC = Path(__file__).with_name("inkloop.dbc")
SUPERVISION_SIGNALS = frozenset({"Crc8", "Counter"})
COUNTERS = 15
"""Alive counters of E2E profile 1: 0 to 14."""


EXTENDED = 1 << 31
"""Added to an arbitration id of 29 bits, as in a DBC and in SocketCAN: one number names the id of a frame."""
FD_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)
"""Bytes that a CAN FD frame may have."""


class Frame(NamedTuple):
    """A data frame: of classic CAN, or of CAN FD. arbitration_id: 11 bits, or 29 bits + EXTENDED."""

    arbitration_id: int
    data: bytes
    is_fd: bool = False

    def __str__(self) -> str:
        return f"{id_text(self.arbitration_id)} [{len(self.data)}] {self.data.hex(' ')}"


def id_text(arbitration_id: int) -> str:
    """An id as text: 0x7A0, or 0x18DA10F1 for one of 29 bits."""
    digits = 8 if arbitration_id & EXTENDED else 3
    return f"0x{arbitration_id & ~EXTENDED:0{digits}X}"


def id_of(message: Message) -> int:
    """Arbitration id of a message of a DBC."""
    return message.frame_id | EXTENDED * message.is_extended_frame


def is_fd(message: Message) -> bool:
    """Whether a message of a DBC travels in CAN FD frames: by its attribute VFrameFormat, or its length."""
    return bool(message.is_fd) or message.length > FD_LENGTHS[8]


@dataclass(frozen=True)
class Reading:
    """Content of a frame: physical values by signal, in the units of the DBC.

    `counter` is None for a message that is not supervised. `intact` is False, and `values` empty, when the check byte
    is wrong. `dropped`: signals without a usable value, and why.
    """

    message: str
    values: Mapping[str, float]
    counter: int | None = None
    intact: bool = True
    dropped: Mapping[str, str] = field(default_factory=dict)


def _loaded(path: Path, strict: bool = True) -> Database:
    try:
        database = cantools.database.load_file(regular(path), "dbc", strict=strict)
    except (OSError, cantools_errors.Error) as error:
        advice = "; strict = false reads the messages without overlapping signals all the same" if strict else ""
        raise FrameError(f"{path} cannot be read as a DBC: {error}{advice}") from error
    if not isinstance(database, Database):
        raise FrameError(f"{path} is no CAN database; expected a DBC")
    return database


@cache
def _bench_database() -> Database:
    """The DBC of the package, which does not change while a process runs."""
    return _loaded(BENCH_DBC)


class Codec:
    """Encodes and decodes frames by one DBC. strict: signals that overlap, or do not fit, are an error of the file."""

    def __init__(self, path: Path = BENCH_DBC, *, strict: bool = True) -> None:
        self.database = database = _bench_database() if path == BENCH_DBC else _loaded(path, strict)
        self._by_name = {message.name: message for message in database.messages}
        self._by_id = {id_of(message): message for message in database.messages}

    @property
    def protocol_version(self) -> int | None:
        """Version of the protocol in the DBC, None if it has none."""
        attribute = self.database.dbc.attributes.get("ProtocolVersion") if self.database.dbc else None
        return None if attribute is None else int(attribute.value)

    def message(self, name: str) -> Message:
        """Description of a message; FrameError for a name that the DBC does not have."""
        if name not in self._by_name:
            raise FrameError(f"no message {name!r} in the DBC; it has {', '.join(sorted(self._by_name))}")
        return self._by_name[name]

    def cycle_time(self, name: str) -> float | None:
        """Seconds between two frames, None for a message without a cycle."""
        cycle_ms = self.message(name).cycle_time
        return None if not cycle_ms else cycle_ms / MS_PER_S

    def data_id(self, name: str) -> int | None:
        """Data id of E2E profile 1, None for a message that is not supervised."""
        dbc = self.message(name).dbc
        attribute = dbc.attributes.get("E2EDataId") if dbc else None
        return int(attribute.value) or None if attribute is not None else None

    def request_id(self, node: str) -> int:
        """Arbitration id of ISO-TP frames to a node, such as `Node.HEAD`."""
        return self.message(f"{node}Request").frame_id

    def answer_id(self, node: str) -> int:
        """Arbitration id of ISO-TP frames from a node."""
        return self.message(f"{node}Answer").frame_id

    def encode(self, name: str, values: Mapping[str, float | str], counter: int | None = None) -> Frame:
        """The frame of a message.

        values: every signal but those of supervision, in the units of the DBC, or a name of its value table.
        counter: 0 to 14 for a supervised message, None for any other.
        Raises FrameError for a value that is missing, unknown, not finite or out of its limits.
        """
        message, data_id = self.message(name), self.data_id(name)
        expected = {signal.name for signal in message.signals} - (SUPERVISION_SIGNALS if data_id else set())
        errors = [f"has no signal {extra!r}" for extra in sorted(set(values) - expected)]
        if not message.is_multiplexed():
            errors += [f"lacks a value for {missing!r}" for missing in sorted(expected - set(values))]
        if (counter is not None) != (data_id is not None) or (counter is not None and not 0 <= counter < COUNTERS):
            needed = f"needs a counter of 0 to {COUNTERS - 1}" if data_id else "takes no counter"
            errors.append(f"{needed}, found {counter}")
        if errors:
            raise FrameError(f"message {name} " + ", ".join(errors))
        raw = {signal: _raw(message, signal, value) for signal, value in values.items()}
        if data_id is None or counter is None:
            return Frame(id_of(message), self._encode_raw(message, raw), is_fd(message))
        data = bytearray(self._encode_raw(message, raw | {"Crc8": 0, "Counter": counter}))
        p01.e2e_p01_protect(data, data_id, increment_counter=False)
        return Frame(id_of(message), bytes(data), is_fd(message))

    def decode(self, frame: Frame, *, strict: bool = True) -> Reading:
        """The content of a frame.

        strict: the frame is one of our protocol: another format or length, or a value out of its limits, is an error.
        Otherwise bytes beyond the message are ignored, classic and FD are alike, and a value out of its limits is
        dropped; one of the value table never is. Raises FrameError for an unknown id, for too few bytes, and if strict.
        A wrong check byte raises nothing: the supervision counts it (`link.node_watch`).
        """
        message = self._by_id.get(frame.arbitration_id)
        if message is None:
            raise FrameError(f"frame {frame}: no message with this id in the DBC")
        if strict and frame.is_fd != is_fd(message):
            found, expected = ("CAN FD", "classic") if frame.is_fd else ("classic", "CAN FD")
            raise FrameError(f"frame {frame} of {message.name} is a {found} frame, expected a {expected} one")
        if len(frame.data) != message.length if strict else len(frame.data) < message.length:
            raise FrameError(f"frame {frame} of {message.name} has {len(frame.data)} bytes, expected {message.length}")
        data, data_id = frame.data[: message.length], self.data_id(message.name)
        counter = data[1] & 0xF if data_id else None
        if data_id and not p01.e2e_p01_check(bytearray(data), data_id):
            return Reading(message.name, {}, counter, intact=False)
        try:
            raw = message.decode(data, decode_choices=False, scaling=False)
        except cantools_errors.Error as error:
            raise FrameError(f"frame {frame} of {message.name} cannot be read, as its signals overlap") from error
        if not isinstance(raw, dict):
            raise FrameError(f"frame {frame} of {message.name} is a container; only plain messages are read")
        values, dropped = dict[str, float](), dict[str, str]()
        for signal, number in raw.items():
            if (data_id and signal in SUPERVISION_SIGNALS) or not isinstance(number, int | float):
                continue
            try:
                values[signal] = _physical(message, signal, number)
            except FrameError as error:
                if strict:
                    raise
                dropped[signal] = str(error)
        return Reading(message.name, values, counter, dropped=dropped)

    def choice(self, name: str, signal: str, value: float) -> str | None:
        """The name of a physical value in the value table of a signal, whose keys are raw; None if it has none."""
        found = self.message(name).get_signal_by_name(signal)
        steps = (value - found.offset) / found.scale
        raw = round(steps) if math.isfinite(steps) else 0
        is_raw = math.isfinite(steps) and abs(steps - raw) <= 1e-6
        return str(found.choices[raw]) if is_raw and found.choices and raw in found.choices else None

    @staticmethod
    def _encode_raw(message: Message, raw: Mapping[str, float]) -> bytes:
        try:
            return message.encode(dict(raw), scaling=False, strict=False)
        except KeyError as error:  # cantools names it bare
            raise FrameError(f"message {message.name} lacks a value for {error}, by its multiplexer") from error
        except cantools_errors.Error as error:
            raise FrameError(f"message {message.name} cannot be encoded: {error}") from error


def _limits(signal: Signal) -> tuple[float, float]:
    """Smallest and largest physical value: those of the DBC, else what the bits hold."""
    if signal.is_float:
        lowest, highest = -math.inf, math.inf
    else:
        bits = signal.length - 1 if signal.is_signed else signal.length
        ends = [signal.offset + signal.scale * raw for raw in (-(2**bits) if signal.is_signed else 0, 2**bits - 1)]
        lowest, highest = min(ends), max(ends)
    return (
        lowest if signal.minimum is None else signal.minimum,
        highest if signal.maximum is None else signal.maximum,
    )


def _checked(message: Message, signal: Signal, value: float, slack: float = 0.0) -> None:
    lowest, highest = _limits(signal)
    if not lowest - slack <= value <= highest + slack:  # also refuses NaN
        unit = f" {signal.unit}" if signal.unit else ""
        raise FrameError(
            f"message {message.name}: {signal.name} is {value:g}{unit}, expected {lowest:.10g} to {highest:.10g}{unit}"
        )


def _raw(message: Message, name: str, value: float | str) -> float:
    """The number on the wire: rounded, halves away from zero as C's round() does."""
    signal = message.get_signal_by_name(name)
    if isinstance(value, str):
        numbers = {str(choice): number for number, choice in (signal.choices or {}).items()}
        if value not in numbers:
            expected = f"one of {', '.join(numbers)}" if numbers else "a number"
            raise FrameError(f"message {message.name}: {name} is {value!r}, expected {expected}")
        return numbers[value]
    half_step = 0.0 if signal.is_float or (signal.scale == 1 and signal.offset == 0) else abs(signal.scale) / 2
    _checked(message, signal, value, slack=half_step * (1 - 1e-9))
    if signal.is_float:
        return (value - signal.offset) / signal.scale
    if isinstance(value, int) and signal.scale == 1:
        return value - int(signal.offset)
    steps = (value - signal.offset) / signal.scale
    whole = math.floor(abs(steps))
    return int(math.copysign(whole + (abs(steps) - whole >= 0.5), steps))


def _physical(message: Message, name: str, raw: float) -> float:
    signal = message.get_signal_by_name(name)
    value = raw if signal.scale == 1 and signal.offset == 0 else raw * signal.scale + signal.offset
    if signal.choices and raw in signal.choices:
        return value
    _checked(message, signal, value, slack=1e-9 * abs(signal.scale))
    return value
