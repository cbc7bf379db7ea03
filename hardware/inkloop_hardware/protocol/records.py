"""Typed records of the frames of the bench, in SI units, and the names of nodes, states and faults in them.

One class per layout of `inkloop.dbc`; a field is the signal of the same name (`pass_mask` is `PassMask`). Lengths are
in m, times in s, shares 0 to 1; temperatures stay in degC, pressures in Pa, irradiance in W/m2.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from enum import IntEnum, StrEnum
from typing import Any, ClassVar, get_type_hints

from inkloop.units import M_PER_UM, S_PER_MS
from inkloop_hardware.errors import FrameError
from inkloop_hardware.protocol.codec import Codec, Frame, Reading


class Node(StrEnum):
    """A node of the bench; its messages begin with its name."""

    HEAD = "Head"
    STAGE = "Stage"
    CURE = "Cure"
    PROFILER = "Profiler"


class State(IntEnum):
    """State of a node."""

    SAFE = 0
    IDLE = 1
    RECEIVING = 2
    VERIFIED = 3
    PRINTING = 4
    PRINTED = 5
    CURING = 6
    CURED = 7
    SCANNING = 8
    MAP_READY = 9
    FAULT = 10


class Fault(IntEnum):
    """Cause of SAFE or FAULT."""

    NONE = 0
    MASTER_LOST = 1
    STOP_REQUEST = 2
    ENABLE_DROPPED = 3
    TWO_MASTERS = 4
    SUPERVISION = 5
    STEP_EXPIRED = 6
    GATE_NOT_CONFIRMED = 7
    LAMP_TIME = 8
    BACK_PRESSURE = 11
    STAGE_POSITION = 12
    SCAN_FAILED = 14
    JOURNAL_DAMAGED = 16
    PASS_UNKNOWN = 17
    STORAGE_FAILED = 18
    JOURNAL_UNREADABLE = 19


class Source(IntEnum):
    """Sender of a stop request."""

    NONE = 0
    OPERATOR = 1
    MASTER = 2
    HEAD = 3
    STAGE = 4
    CURE = 5
    PROFILER = 6


SI = {"": 1.0, "um": M_PER_UM, "ms": S_PER_MS, "%": 1e-2, "degC": 1.0, "Pa": 1.0, "W/m2": 1.0}
"""One unit of the DBC in the unit of the records."""


@dataclass(frozen=True)
class StopRequest:
    """Asks every node to take its de-energised state; no emergency stop."""

    message: ClassVar[str] = "StopRequest"
    active: bool
    source: Source


@dataclass(frozen=True)
class MasterAlive:
    """Heartbeat of the master, with the enables of the present step."""

    message: ClassVar[str] = "MasterAlive"
    lamp_enable: bool
    gate_enable: bool
    motion_enable: bool
    session: int
    job: int


@dataclass(frozen=True)
class NodeStatus:
    """State and heartbeat of a node."""

    message: ClassVar[str] = "Status"
    node: Node
    lamp_on: bool
    gate_open: bool
    gate_closed: bool
    ready: bool
    state: State
    pass_mask: int
    fault: Fault
    layer: int
    boot_count: int
    unknown_mask: int
    protocol_version: int


@dataclass(frozen=True)
class NodeFault:
    """Begin, change or end of a fault; `node_time` s by the node's own clock."""

    message: ClassVar[str] = "Fault"
    node: Node
    fault: Fault
    pass_: int
    layer: int
    node_time: float


@dataclass(frozen=True)
class HeadMeasurement:
    """`head_temperature` degC, `back_pressure` Pa, `droplets` since the node started, modulo 2^32."""

    message: ClassVar[str] = "HeadMeasurement"
    head_temperature: float
    back_pressure: float
    droplets: int


@dataclass(frozen=True)
class StageMeasurement:
    """Position of the stage, m."""

    message: ClassVar[str] = "StageMeasurement"
    position_x: float
    position_y: float
    position_z: float


@dataclass(frozen=True)
class CureMeasurement:
    """`irradiance` W/m2, `lamp_temperature` degC, `lamp_time` s of the present or last pulse."""

    message: ClassVar[str] = "CureMeasurement"
    irradiance: float
    lamp_temperature: float
    lamp_time: float


@dataclass(frozen=True)
class ProfilerMeasurement:
    """`profiler_temperature` degC; `scan_progress`, `valid_share` 0 to 1; `scans` modulo 65536."""

    message: ClassVar[str] = "ProfilerMeasurement"
    profiler_temperature: float
    scan_progress: float
    valid_share: float
    scans: int


Record = (
    StopRequest
    | MasterAlive
    | NodeStatus
    | NodeFault
    | HeadMeasurement
    | StageMeasurement
    | CureMeasurement
    | ProfilerMeasurement
)
BUS_WIDE = (StopRequest, MasterAlive, HeadMeasurement, StageMeasurement, CureMeasurement, ProfilerMeasurement)
PER_NODE = (NodeStatus, NodeFault)


def kinds() -> Mapping[str, tuple[type[Any], Node | None]]:
    """Record class and node of every message that has a record."""
    plain: dict[str, tuple[type[Any], Node | None]] = {kind.message: (kind, None) for kind in BUS_WIDE}
    return plain | {f"{node}{kind.message}": (kind, node) for kind in PER_NODE for node in Node}


KINDS = kinds()
TYPES = {
    kind: {field: type_ for field, type_ in get_type_hints(kind).items() if field not in ("message", "node")}
    for kind in (*BUS_WIDE, *PER_NODE)
}
"""Type of each field that is a signal."""


def signal_name(field: str) -> str:
    """Signal of a field."""
    return "".join(part.capitalize() for part in field.split("_"))


def pack(codec: Codec, record: Record, counter: int | None = None) -> Frame:
    """Frame of a record; `counter` 0 to 14 for a supervised message. FrameError for a value out of its limits."""
    name = f"{record.node}{record.message}" if isinstance(record, PER_NODE) else record.message
    message = codec.message(name)
    values = {}
    for field in fields(record):
        if field.name == "node":
            continue
        signal, value = signal_name(field.name), getattr(record, field.name)
        scale = SI[message.get_signal_by_name(signal).unit or ""]
        values[signal] = value / scale if isinstance(value, float) else int(value)
    return codec.encode(name, values, counter)


def unpack(codec: Codec, reading: Reading) -> Record:
    """Record of an intact reading; FrameError for a damaged one, or where no record belongs to its message."""
    if not reading.intact:
        raise FrameError(f"message {reading.message} is damaged: its check byte is wrong, so it has no content")
    if reading.message not in KINDS:
        raise FrameError(f"message {reading.message} has no record; those with one are {', '.join(sorted(KINDS))}")
    kind, node = KINDS[reading.message]
    message = codec.message(reading.message)
    found: dict[str, Any] = {} if node is None else {"node": node}
    for field, type_ in TYPES[kind].items():
        signal = signal_name(field)
        value = reading.values[signal]
        try:
            found[field] = value * SI[message.get_signal_by_name(signal).unit or ""] if type_ is float else type_(value)
        except ValueError as error:
            raise FrameError(
                f"message {reading.message}: {signal} is {value:g}, which version {codec.protocol_version} of the "
                f"protocol does not know; does the node use a newer one?"
            ) from error
    record: Record = kind(**found)
    return record
