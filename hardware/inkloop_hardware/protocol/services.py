"""Services of a node: routines, their keys and outcomes, and the messages of its refusals.

The numbers are those of `firmware/node/uds.h`; docs/reference/node-services.md explains them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Annotated

import udsoncan
from udsoncan.exceptions import InvalidResponseException, UnexpectedResponseException

from inkloop_hardware.protocol import layout
from inkloop_hardware.protocol.records import Node


class Routine(IntEnum):
    """Routine identifiers of service 0x31."""

    CLEAR = 0x0200
    HOME = 0x0201
    PURGE = 0x0202
    PASS = 0x0203
    CURE = 0x0204
    SCAN = 0x0205
    DRY_RUN = 0x0206
    MOVE = 0x0207
    SELF_TEST = 0x0208


class ClearOption(IntFlag):
    """Option of the routine `clear`: 0 is the plain one."""

    OPERATOR = 1
    """a person is present and releases the node"""
    ABANDON = 2
    """the open layer is abandoned; needs OPERATOR"""


class Station(IntEnum):
    """Option of the routine `move`."""

    HOME = 0
    PRINT = 1
    CURE = 2
    SCAN = 3


class Outcome(IntEnum):
    """Outcome of a routine with a key."""

    DONE = 0
    DONE_BEFORE = 1
    """nothing was changed by this request"""
    UNDER_WAY = 2
    UNKNOWN = 3
    """begun, and its progress is unknown: scan before anything more is jetted"""
    NEVER = 4


@dataclass(frozen=True)
class Key:
    """Identifies a step and its attempt; the same key is never done twice.

    job: 32 bits; layer: counted from 1, 16 bits; pass_: counted from 0; attempt: 1 for the first try.
    """

    job: Annotated[int, 4]
    layer: Annotated[int, 2]
    pass_: Annotated[int, 1] = 0
    attempt: Annotated[int, 1] = 1

    def __bytes__(self) -> bytes:
        return layout.pack(self)

    @classmethod
    def of(cls, data: bytes) -> Key:
        """The key in eight bytes."""
        return layout.unpack(cls, data)

    def __str__(self) -> str:
        again = f", attempt {self.attempt}" if self.attempt > 1 else ""
        return f"layer {self.layer}, pass {self.pass_}{again}"


OPTIONS: Mapping[Routine, layout.Part] = {
    Routine.CLEAR: layout.Part("option", ClearOption, 1),
    Routine.PASS: layout.Part("colour", int, 1),
    Routine.CURE: layout.Part("duration", float, 2),
    Routine.DRY_RUN: layout.Part("on", int, 1),
    Routine.MOVE: layout.Part("station", Station, 1),
    Routine.SELF_TEST: layout.Part("lamp_time", float, 2),
}
"""Option behind the key of a request to start a routine."""

ROUTINES: Mapping[Node, tuple[Routine, ...]] = {
    Node.HEAD: (Routine.PURGE, Routine.PASS, Routine.SELF_TEST),
    Node.STAGE: (Routine.HOME, Routine.MOVE),
    Node.CURE: (Routine.CURE, Routine.SELF_TEST),
    Node.PROFILER: (Routine.SCAN,),
}
"""Routines of a node besides those of all nodes, `clear` and `dry run`."""

REFUSALS = {
    0x11: "it does not know the service; does it run other firmware?",
    0x12: "it does not know the subfunction; does it run other firmware?",
    0x13: "the request has a length that it does not expect; does it run other firmware?",
    0x21: "it is busy with another step; wait for that step to end",
    0x22: "it is off, not enabled, not ready, not homed, its gate is not confirmed, or a person is needed: check its "
    "state and clear it, home the stage, wait for ink temperature and back pressure",
    0x24: "it expects another step or layer: its journal holds what was done; compare job, layer and pass",
    0x26: "it began and gave up: see its state and cause",
    0x31: "it has no such routine, layer, option or pattern: compare its limits, roles and the size of the grid",
    0x71: "it was sent more bytes than announced; begin the transfer again",
    0x72: "the checksum differs: bytes were altered on the way; check cables and termination",
    0x73: "it expects another block; begin the transfer again",
    0x78: "it is still busy",
}
"""Negative response codes of docs/reference/node-services.md: the error and its remedy."""


UNREADABLE = (InvalidResponseException, UnexpectedResponseException, NotImplementedError)
"""Errors of udsoncan for an invalid answer; the last one for numbers of more than 64 bits."""
NEGATIVE, POSITIVE = 0x7F, 0x40
ECHOED = {0x22: slice(1, 3), 0x36: slice(1, 2)}
"""Bytes of a request that its positive answer repeats."""
ROUTINE_CONTROL, KEY_AT, KEY_ECHO = 0x31, slice(4, 12), slice(5, 13)


class Bytes(udsoncan.DidCodec):
    """Reads an identifier as its bytes."""

    def encode(self, value: bytes) -> bytes:
        """The bytes as they are."""
        return value

    def decode(self, payload: bytes) -> bytes:
        """The bytes as they are."""
        return payload

    def __len__(self) -> int:
        raise udsoncan.DidCodec.ReadAllRemainingData


def is_answer(request: bytes, message: bytes) -> bool:
    """Whether a message answers this request, by its first bytes."""
    if message[:1] == bytes([NEGATIVE]):
        return message[1:2] == request[:1]
    if not message or message[0] != request[0] + POSITIVE:
        return False
    if request[0] == ROUTINE_CONTROL:
        return message[1:4] == request[1:4] and message[KEY_ECHO] == request[KEY_AT]
    echoed = ECHOED.get(request[0])
    return echoed is None or message[echoed] == request[echoed]
