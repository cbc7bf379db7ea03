"""Records of the identifiers of a node (service 0x22).

Big-endian layouts of `firmware/node/services.h` and `journal.h`. Times are in s of the node's own clock since its
power-up; 0 for an event that has not happened.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, IntFlag
from struct import Struct

from inkloop.units import MS_PER_S
from inkloop_hardware.protocol.services import Key
from inkloop_hardware.protocol.vocabulary import Fault, State

STATE = Struct(">4BIH6BHHIII")
TIMES = Struct(">7I")
LIMITS = Struct(">7IH")
MAP_SIZE = Struct(">IHH")
TRANSFER = Struct(">BBHIII")
RECORD = Struct(">I4BIHHI4BIII4x")


class Identifier(IntEnum):
    """Identifiers of service 0x22."""

    VERSION = 0xF195
    STATE = 0x0100
    TIMES = 0x0101
    LIMITS = 0x0102
    MAP = 0x0103
    TRANSFER = 0x0104
    JOURNAL = 0x0110


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

    state: State
    cause: Fault
    roles: Roles
    flags: Flags
    job: int
    layer: int
    passes: int
    done: int
    unknown: int
    cured: int
    layer_flags: LayerFlags
    step: Step
    boots: int
    session: int
    pattern_crc: int
    clock: float
    gate_pulses: int

    @classmethod
    def of(cls, data: bytes) -> NodeState:
        """From identifier 0100."""
        state, cause, roles, flags, job, layer, passes, done, unknown, cured, remembered, step, *rest = STATE.unpack(
            data
        )
        boots, session, pattern_crc, clock_ms, gate_pulses = rest
        return cls(
            *(State(state), Fault(cause), Roles(roles), Flags(flags), job, layer, passes, done, unknown, cured),
            *(LayerFlags(remembered), Step(step), boots, session, pattern_crc, clock_ms / MS_PER_S, gate_pulses),
        )

    @property
    def layer_is_complete(self) -> bool:
        """Whether every pass of the layer was jetted, and none is unknown."""
        return self.passes > 0 and self.done == (1 << self.passes) - 1 and not self.unknown


@dataclass(frozen=True)
class NodeTimes:
    """Times of the events that its interlocks watch [s of its clock]."""

    now: float
    master_alive: float
    off: float
    lamp_on: float
    lamp_off: float
    gate_opened: float
    gate_closed: float

    @classmethod
    def of(cls, data: bytes) -> NodeTimes:
        """From identifier 0101."""
        return cls(*(number / MS_PER_S for number in TIMES.unpack(data)))


@dataclass(frozen=True)
class NodeLimits:
    """Limits of a node: `pattern_bytes` of packed cells, `block` bytes of a transfer block, longest times [s]."""

    pattern_bytes: int
    alive: float
    lamp: float
    gate: float
    pass_: float
    motion: float
    scan: float
    block: int

    @classmethod
    def of(cls, data: bytes) -> NodeLimits:
        """From identifier 0102."""
        pattern_bytes, *limits_ms, block = LIMITS.unpack(data)
        alive, lamp, gate, pass_, motion, scan = (limit / MS_PER_S for limit in limits_ms)
        return cls(pattern_bytes, alive, lamp, gate, pass_, motion, scan, block)


@dataclass(frozen=True)
class MapSize:
    """The map of the last scan: bytes to upload, 0 if there is none; shape (nx, ny)."""

    size: int
    nx: int
    ny: int

    @classmethod
    def of(cls, data: bytes) -> MapSize:
        """From identifier 0103."""
        return cls(*MAP_SIZE.unpack(data))


@dataclass(frozen=True)
class TransferState:
    """Progress of a transfer: the expected block, the bytes transferred, of how many."""

    active: bool
    upload: bool
    next_counter: int
    layer: int
    job: int
    done: int
    size: int

    @classmethod
    def of(cls, data: bytes) -> TransferState:
        """From identifier 0104."""
        flags, counter, layer, job, done, size = TRANSFER.unpack(data)
        return cls(bool(flags & 1), bool(flags & 2), counter, layer, job, done, size)


@dataclass(frozen=True)
class JournalRecord:
    """One record; `number` counts up over the node's whole life, the rest is the state of the layer at that time."""

    number: int
    kind: Happening
    step: Step
    key: Key
    boots: int
    pattern_crc: int
    passes: int
    done: int
    unknown: int
    cured: int
    layer_flags: LayerFlags
    clock: float

    @classmethod
    def of(cls, data: bytes) -> tuple[JournalRecord, ...]:
        """From identifier 0110, newest first."""
        return tuple(cls._at(data, at) for at in range(0, len(data), RECORD.size))

    @classmethod
    def _at(cls, data: bytes, at: int) -> JournalRecord:
        number, kind, step, pass_, attempt, job, layer, boots, crc, *progress = RECORD.unpack_from(data, at)
        passes, done, unknown, cured, flags, clock_ms, _reserved = progress
        key = Key(job, layer, pass_, attempt)
        return cls(
            *(number, Happening(kind), Step(step), key, boots, crc, passes, done, unknown, cured),
            *(LayerFlags(flags), clock_ms / MS_PER_S),
        )
