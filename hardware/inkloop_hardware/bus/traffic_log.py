"""Traffic log: all frames of a bus in a BLF or ASC file."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from pathlib import Path

import can
from can.io import ASCWriter, BLFWriter

from inkloop_hardware.errors import BusError

WRITERS = {".blf": BLFWriter, ".asc": ASCWriter}
FLUSH_CYCLE = 1.0
"""Seconds between two writes to the disk. A frame waits one cycle for earlier ones, as two threads log: a sent frame
has the time before it left, a received one that at which the adapter took it. A killed process loses two cycles."""
SET = 0.05
"""Seconds that the clock of the wall jumps by when it is set; less is how it is kept in step (assumed)."""


class SteadyClock:
    """Times of frames by the clock of the wall as it goes on if nobody sets it."""

    def __init__(self, wall: Callable[[], float] = time.time, steady: Callable[[], float] = time.monotonic) -> None:
        self._wall, self._steady = wall, steady
        self._began = self._ahead = wall() - steady()

    def of(self, timestamp: float) -> float:
        """The time of a frame that has just come with this time of the wall, at most a cycle of the log ago.

        Frames with the same time keep the same one.
        """
        steady = self._steady()
        ahead = self._wall() - steady
        if abs(ahead - self._ahead) > SET:
            self._ahead = ahead
        now = self._began + steady
        return min(max(timestamp - (self._ahead - self._began), now - FLUSH_CYCLE), now + SET)


class TrafficLog:
    """A log whose times never go back, and that stays readable without a close, up to shortly before its end.

    time_of: the time that is logged, of that of a frame; default: by a `SteadyClock`, as somebody may set the clock of
    the wall. BusError for an unknown suffix or a file that cannot be written. An existing file is kept: a resumed run
    continues in traffic-2.blf.
    """

    def __init__(self, path: Path, time_of: Callable[[float], float] | None = None) -> None:
        self._time_of = time_of or SteadyClock().of
        if path.suffix.lower() not in WRITERS:
            raise BusError(f"traffic log {path}: its suffix is {path.suffix!r}, expected .blf or .asc")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = WRITERS[path.suffix.lower()](unused(path))
        except OSError as error:
            raise BusError(f"traffic log {path} cannot be written: {error}") from error
        self._flushed = 0.0
        self._waiting: list[can.Message] = []
        self._settled = self._newest = self._written = 0.0

    def take(self, message: can.Message) -> None:
        """Log one frame, in the order of time; one that comes too late for it gets the time of the frame before."""
        message.timestamp = self._time_of(message.timestamp)
        self._waiting.append(message)
        self._newest = max(self._newest, message.timestamp)

    def flush(self, now: float) -> None:
        """Write the frames to the disk, once per FLUSH_CYCLE."""
        if now - self._flushed < FLUSH_CYCLE:
            return
        self._flushed = now
        self._write(self._settled)
        self._settled = self._newest
        if isinstance(self._writer, BLFWriter):
            _end_container(self._writer)
        self._writer.file.flush()

    def close(self) -> None:
        """End the file."""
        self._write(math.inf)
        self._writer.stop()

    def _write(self, until: float) -> None:
        """Write the waiting frames up to this time; the order of equal times is kept."""
        due = sorted((one for one in self._waiting if one.timestamp <= until), key=lambda one: one.timestamp)
        self._waiting = [one for one in self._waiting if one.timestamp > until]
        for message in due:
            message.timestamp = self._written = max(message.timestamp, self._written)
            self._writer.on_message_received(message)


def unused(path: Path) -> Path:
    """The path, or the first of name-2, name-3 ... that does not exist yet."""
    names = (path, *(path.with_stem(f"{path.stem}-{number}") for number in range(2, 1000)))
    return next((name for name in names if not os.path.lexists(name)), path)


def _end_container(writer: BLFWriter) -> None:
    """As `BLFWriter.stop`, without closing: the header holds the time origin of all frames."""
    writer._flush()
    end = writer.file.tell()
    writer.file.seek(0)
    writer._write_header(end)
    writer.file.seek(end)
