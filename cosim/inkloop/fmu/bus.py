"""Operations of the bus CAN by FMI-LS-BUS (Network Abstraction), as binaries of FMUs hold them.

An operation is its code and total length, 32 bits each, then its arguments; numbers are little-endian.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import NamedTuple

FORMAT_ERROR, TRANSMIT, CONFIRM, CONFIGURATION, STATUS, WAKEUP = 0x01, 0x10, 0x20, 0x40, 0x41, 0x42
_KNOWN = (FORMAT_ERROR, CONFIRM, 0x30, 0x31, CONFIGURATION, STATUS, WAKEUP)
"""Operations besides frames; 0x30 Arbitration Lost, 0x31 Bus Error."""
_HEAD = struct.Struct("<II")
_FRAME = struct.Struct("<IBBH")


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
        """Answers of an ideal bus to the sender: Confirm to a frame, Format Error to what it does not know."""
        if frame := self.frame:
            return operation(CONFIRM, struct.pack("<I", frame.identifier))
        return b"" if self.is_known else format_error(self.content)

    @property
    def is_known(self) -> bool:
        """Whether it is an operation of the bus CAN."""
        return self.frame is not None if self.code == TRANSMIT else self.code in _KNOWN


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
