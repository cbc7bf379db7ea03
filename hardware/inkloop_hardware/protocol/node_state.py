"""Records of the identifiers of a node (service 0x22).

Big-endian layouts of `firmware/node/services.h` and `journal.h`. Times are in s of the node's own clock since its
power-up; 0 for an event that has not happened.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Annotated

from inkloop_hardware.protocol import layout
from inkloop_hardware.protocol.records import Fault, State
from inkloop_hardware.protocol.services import Key


class Identifier(IntEnum):
    """Identifiers of service 0x22."""

    VERSION = 0xF195
    STATE = 0x0100
    TIMES = 0x0101
    LIMITS = 0x0102
    MAP = 0x0103
    TRANSFER = 0x0104
    JOURNAL = 0x0110
    SESSION = 0xF186


class Session(IntEnum):
    """Diagnostic session; both have the same services."""

    DEFAULT = 1
    EXTENDED = 3


class Roles(IntFlag):
    """Devices of a node."""

    HEAD = 1
    STAGE = 2
    CURE = 4
    PROFILER = 8


class Flags(IntFlag):
    """Conditions of a node."""

    NEEDS_OPERATOR = 1
    """clear is refused unless a person asks for it"""
    STOPPED = 2
    """a stop request is active"""
    PATTERN_LOADED = 4
    DRY_RUN = 8
    MAP_READY = 16
    JOURNAL_DAMAGED = 32
    BY_WATCHDOG = 64
    """its watchdog caused the last power-up"""
    JOURNAL_UNREADABLE = 128
    """its journal could not be read at power-up; clear is refused unless the open layer is given up"""


class LayerFlags(IntFlag):
    """State of the open layer, without its passes."""

    ABANDONED = 1
    """the layer will not be finished"""
    CURE_UNKNOWN = 2
    """a cure was interrupted and not repeated yet"""
    ACKNOWLEDGED = 4
    """a person has acknowledged the unknown step"""


class TransferFlags(IntFlag):
    """State of a transfer."""

    ACTIVE = 1
    UPLOAD = 2


class Step(IntEnum):
    """Step that a node makes, or that a record of its journal is about."""

    NONE = 0
    HOME = 1
    MOVE = 2
    PURGE = 3
    PASS = 4
    CURE = 5
    SCAN = 6
    SELF_TEST = 7


class Happening(IntEnum):
    """Event of a record of the journal."""

    BOOT = 1
    PATTERN = 2
    INTENT = 3
    DONE = 4
    UNKNOWN = 5
    CLEAR = 6
    WATCHDOG = 7
    """a boot that the watchdog caused"""


@dataclass(frozen=True)
class NodeState:
    """State of a node, its newest layer and its present step.

    passes: of the layer, 0 if it has no pattern; done, unknown, cured: a bit per pass; pattern_crc: CRC-32 of the
    layer's pattern as transferred; gate_pulses: since power-up.
    """

    state: Annotated[State, 1]
    cause: Annotated[Fault, 1]
    roles: Annotated[Roles, 1]
    flags: Annotated[Flags, 1]
    job: Annotated[int, 4]
    layer: Annotated[int, 2]
    passes: Annotated[int, 1]
    done: Annotated[int, 1]
    unknown: Annotated[int, 1]
    cured: Annotated[int, 1]
    layer_flags: Annotated[LayerFlags, 1]
    step: Annotated[Step, 1]
    boots: Annotated[int, 2]
    session: Annotated[int, 2]
    pattern_crc: Annotated[int, 4]
    clock: Annotated[float, 4]
    gate_pulses: Annotated[int, 4]

    @classmethod
    def of(cls, data: bytes) -> NodeState:
        """From identifier 0100."""
        return layout.unpack(cls, data)

    @property
    def layer_is_complete(self) -> bool:
        """Whether every pass of the layer was jetted, and none is unknown."""
        return self.passes > 0 and self.done == (1 << self.passes) - 1 and not self.unknown


@dataclass(frozen=True)
class NodeTimes:
    """Times of the events that its interlocks watch [s of its clock]."""

    now: Annotated[float, 4]
    master_alive: Annotated[float, 4]
    off: Annotated[float, 4]
    lamp_on: Annotated[float, 4]
    lamp_off: Annotated[float, 4]
    gate_opened: Annotated[float, 4]
    gate_closed: Annotated[float, 4]

    @classmethod
    def of(cls, data: bytes) -> NodeTimes:
        """From identifier 0101."""
        return layout.unpack(cls, data)


@dataclass(frozen=True)
class NodeLimits:
    """Limits of a node: `pattern_bytes` of packed cells, `block` bytes of a transfer block, longest times [s]."""

    pattern_bytes: Annotated[int, 4]
    alive: Annotated[float, 4]
    lamp: Annotated[float, 4]
    gate: Annotated[float, 4]
    pass_: Annotated[float, 4]
    motion: Annotated[float, 4]
    scan: Annotated[float, 4]
    block: Annotated[int, 2]

    @classmethod
    def of(cls, data: bytes) -> NodeLimits:
        """From identifier 0102."""
        return layout.unpack(cls, data)


@dataclass(frozen=True)
class MapSize:
    """The map of the last scan: bytes to upload, 0 if there is none; shape (nx, ny)."""

    size: Annotated[int, 4]
    nx: Annotated[int, 2]
    ny: Annotated[int, 2]

    @classmethod
    def of(cls, data: bytes) -> MapSize:
        """From identifier 0103."""
        return layout.unpack(cls, data)


@dataclass(frozen=True)
class TransferState:
    """Progress of a transfer: the expected block, the bytes transferred, of how many."""

    flags: Annotated[TransferFlags, 1]
    next_counter: Annotated[int, 1]
    layer: Annotated[int, 2]
    job: Annotated[int, 4]
    done: Annotated[int, 4]
    size: Annotated[int, 4]

    @classmethod
    def of(cls, data: bytes) -> TransferState:
        """From identifier 0104."""
        return layout.unpack(cls, data)


@dataclass(frozen=True)
class JournalRecord:
    """One record; `number` counts up over the node's whole life, passes to flags are those of the layer at that time.

    check: CRC-32 of the bytes before it.
    """

    number: Annotated[int, 4]
    kind: Annotated[Happening, 1]
    step: Annotated[Step, 1]
    pass_: Annotated[int, 1]
    attempt: Annotated[int, 1]
    job: Annotated[int, 4]
    layer: Annotated[int, 2]
    boots: Annotated[int, 2]
    pattern_crc: Annotated[int, 4]
    passes: Annotated[int, 1]
    done: Annotated[int, 1]
    unknown: Annotated[int, 1]
    cured: Annotated[int, 1]
    layer_flags: Annotated[LayerFlags, 4]
    clock: Annotated[float, 4]
    reserved: Annotated[int, 4]
    check: Annotated[int, 4]

    @classmethod
    def of(cls, data: bytes) -> tuple[JournalRecord, ...]:
        """From identifier 0110, newest first."""
        size = layout.size(cls)
        return tuple(layout.unpack(cls, data[at : at + size]) for at in range(0, len(data), size))

    @property
    def key(self) -> Key:
        """The step that it is about."""
        return Key(self.job, self.layer, self.pass_, self.attempt)
