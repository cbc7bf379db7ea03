"""What the master and the bus process say to each other: length, kind, bytes, over a pair of pipes.

Frames travel as fixed records of 24 bytes, many in one message; only standard data frames do.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from enum import IntEnum
from io import BufferedIOBase, RawIOBase
from struct import Struct

from inkloop_hardware.codec import Frame

HEAD = Struct("<BI")
FRAME = Struct("<dIB8s3x")
FRAMES_AT_ONCE = 128
"""So that a message to the bus process is below 4096 bytes, which a pipe takes whole or not at all."""


class Kind(IntEnum):
    """Kinds of messages; SETTINGS to CLOSE go to the bus process."""

    SETTINGS = 1
    """JSON: `settings`, `session`, `job`"""
    ALIVE = 2
    """one byte: enables"""
    FRAMES = 3
    """either way"""
    STOP = 4
    """one byte: active"""
    JOB = 5
    """number as text"""
    CLOSE = 6
    OPENED = 7
    """name of the adapter"""
    CLOCK = 8
    """eight bytes: seconds of the bus process's clock; every frame before it was read"""
    WORDS = 9
    """a sentence for the log"""
    AWAY = 11
    """a sentence: the adapter is gone and is being opened again; empty: it is there"""
    FAILED = 10
    """a sentence; the bus process ends"""


def write_message(stream: RawIOBase, kind: Kind, content: bytes = b"") -> None:
    """One message, whole; OSError if nobody reads any more."""
    rest = memoryview(HEAD.pack(kind, len(content)) + content)
    while rest:
        rest = rest[stream.write(rest) or 0 :]


def read_message(stream: BufferedIOBase) -> tuple[Kind, bytes] | None:
    """The next message of a buffered stream, None at its end."""
    head = stream.read(HEAD.size)
    if len(head) < HEAD.size:
        return None
    kind, length = HEAD.unpack(head)
    content = stream.read(length)
    return (Kind(kind), content) if len(content) == length else None


def pack_frames(frames: Iterable[Frame], now: float = 0.0) -> bytes:
    """Records of frames; `now`: seconds of the sender's clock."""
    return b"".join(FRAME.pack(now, identifier, len(data), data) for identifier, data in frames)


def unpack_frames(content: bytes) -> Iterator[tuple[float, Frame]]:
    """Time and frame of each record."""
    for now, identifier, length, data in FRAME.iter_unpack(content):
        yield now, Frame(identifier, data[:length])
