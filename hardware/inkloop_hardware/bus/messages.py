"""Messages between the master and the bus process: kind, length, bytes, over a pair of pipes.

Frames are records of a head and up to 64 data bytes, many in one message.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from enum import IntEnum
from io import BufferedIOBase, RawIOBase
from struct import Struct

from inkloop_hardware.protocol.codec import Frame

HEAD = Struct("<BI")
FRAME_HEAD = Struct("<dI?B")
"""Seconds, arbitration id, whether it is a frame of CAN FD, data bytes that follow."""
FRAMES_AT_ONCE = 52
"""Keeps a message to the bus process below 4096 bytes, which a pipe takes whole or not at all."""


class Kind(IntEnum):
    """Kinds of messages; SETTINGS to CLOSE go to the bus process."""

    SETTINGS = 1
    """JSON: `settings`, `session`, `job`"""
    ALIVE = 2
    """one byte: enables"""
    FRAMES = 3
    """either way"""
    JOB = 5
    """number as text"""
    CLOSE = 6
    OPENED = 7
    """priority that the process was granted"""
    CLOCK = 8
    """eight bytes: seconds of the bus process's clock; every frame before it was read"""
    MESSAGE = 9
    """a sentence for the log"""
    DISCONNECTED = 11
    """a sentence: the adapter is disconnected and is being opened again; empty: it is connected"""
    FAILED = 10
    """a sentence: the reason why the bus process ends"""


def write_message(stream: RawIOBase, kind: Kind, content: bytes = b"") -> None:
    """Write one message, whole; OSError if the reader has ended."""
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
    return b"".join(FRAME_HEAD.pack(now, identifier, is_fd, len(data)) + data for identifier, data, is_fd in frames)


def unpack_frames(content: bytes) -> Iterator[tuple[float, Frame]]:
    """Time and frame of each record."""
    at = 0
    while at < len(content):
        now, identifier, is_fd, length = FRAME_HEAD.unpack_from(content, at)
        at += FRAME_HEAD.size + length
        yield now, Frame(identifier, content[at - length : at], is_fd)


ROOM = 8 << 20
"""Bytes that wait at most; the nodes' status of an hour and more."""
LAST_WAIT = 2.0
"""Seconds for the rest to leave at the end."""


class Outbox:
    """Writes messages in order without blocking the caller; beyond ROOM it drops messages put with `may_drop`.

    dropped: frames of dropped messages.
    """

    def __init__(self, stream: RawIOBase) -> None:
        self.dropped = 0
        self._stream = stream
        self._waiting: list[tuple[Kind, bytes]] = []
        self._bytes = 0
        self._closed = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._write, daemon=True)
        self._thread.start()

    def put(self, kind: Kind, content: bytes, *, may_drop: bool = False) -> None:
        """Queue a message; returns at once."""
        with self._changed:
            if may_drop and self._bytes + len(content) > ROOM:
                self.dropped += sum(1 for _ in unpack_frames(content)) if kind is Kind.FRAMES else 0
                return
            self._waiting.append((kind, content))
            self._bytes += len(content)
            self._changed.notify()

    def close(self) -> None:
        """Wait up to LAST_WAIT seconds until all messages are written."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join(LAST_WAIT)

    def _write(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._closed)
                messages, self._waiting, self._bytes = self._waiting, [], 0
                if not messages:
                    return
            try:
                for kind, content in messages:
                    write_message(self._stream, kind, content)
            except OSError:  # the reader has ended; the end of stdin then ends the process
                return
