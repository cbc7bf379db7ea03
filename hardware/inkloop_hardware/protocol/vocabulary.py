"""Names of the protocol: nodes, states, faults. The value tables of `inkloop.dbc` are the same."""

from __future__ import annotations

from enum import IntEnum, StrEnum


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
