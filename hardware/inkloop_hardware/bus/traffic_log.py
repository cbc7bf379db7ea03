"""Traffic log: all frames of a bus in a BLF or ASC file."""

from __future__ import annotations

from pathlib import Path

import can
from can.io import ASCWriter, BLFWriter

from inkloop_hardware.errors import BusError

WRITERS = {".blf": BLFWriter, ".asc": ASCWriter}
FLUSH_CYCLE = 1.0
"""Seconds of traffic that a killed process may lose."""


class TrafficLog:
    """A log that stays readable without a close, up to FLUSH_CYCLE before its end.

    BusError for an unknown suffix or a file that cannot be written. An existing file is kept: a resumed run continues
    in traffic-2.blf.
    """

    def __init__(self, path: Path) -> None:
        if path.suffix.lower() not in WRITERS:
            raise BusError(f"traffic log {path}: its suffix is {path.suffix!r}, expected .blf or .asc")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = WRITERS[path.suffix.lower()](unused(path))
        except OSError as error:
            raise BusError(f"traffic log {path} cannot be written: {error}") from error
        self._flushed = 0.0
        self._first: float | None = None

    def take(self, message: can.Message) -> None:
        """Write one frame. Sent and received ones come from two threads: in an ASC file a frame from before the first
        one would get another kind of time, so it gets that of the first."""
        if self._first is None:
            self._first = message.timestamp
        message.timestamp = max(message.timestamp, self._first)
        self._writer.on_message_received(message)

    def flush(self, now: float) -> None:
        """Write the frames to the disk, once per FLUSH_CYCLE."""
        if now - self._flushed < FLUSH_CYCLE:
            return
        self._flushed = now
        if isinstance(self._writer, BLFWriter):
            _end_container(self._writer)
        self._writer.file.flush()

    def close(self) -> None:
        """End the file."""
        self._writer.stop()


def unused(path: Path) -> Path:
    """The path, or the first of name-2, name-3 ... that does not exist yet."""
    names = (path, *(path.with_stem(f"{path.stem}-{number}") for number in range(2, 1000)))
    return next((name for name in names if not name.exists()), path)


def _end_container(writer: BLFWriter) -> None:
    """Do what `BLFWriter.stop` does, without closing: the header holds the time origin of all frames."""
    writer._flush()
    end = writer.file.tell()
    writer.file.seek(0)
    writer._write_header(end)
    writer.file.seek(end)
