"""Frames of a traffic log, and the ISO-TP messages in them."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import can

from inkloop_hardware.bus.frames import data_frame
from inkloop_hardware.bus.traffic_log import WRITERS
from inkloop_hardware.errors import BusError
from inkloop_hardware.protocol.codec import Frame

SINGLE, FIRST, CONSECUTIVE = 0, 1, 2


class Seen(NamedTuple):
    """A frame in a log: `at` is its second, `sent` whether the master sent it."""

    at: float
    sent: bool
    frame: Frame


def parts_of(path: Path) -> list[Path]:
    """A log and those of resumed runs in the same folder: traffic.blf, traffic-2.blf, ..., as far as they exist."""
    found = [path]
    while (later := path.with_stem(f"{path.stem}-{len(found) + 1}")).exists():
        found.append(later)
    return found


def read_traffic(path: Path) -> list[Seen]:
    """Data frames of a log, by time. BusError for a file that is not a log.

    A sent frame is logged once it has left, so the answer to it may stand before it; its time is that before it left.
    """
    if path.suffix.lower() not in WRITERS:
        raise BusError(f"traffic log {path}: its suffix is {path.suffix!r}, expected .blf or .asc")
    try:
        with can.LogReader(path, relative_timestamp=False) as log:  # ASC only: BLF takes no notice of it
            frames = [
                Seen(message.timestamp, not message.is_rx, frame)
                for message in log
                if (frame := data_frame(message)) is not None
            ]
    except OSError as error:
        raise BusError(f"traffic log {path} cannot be read: {error.strerror or error}") from error
    except Exception as error:  # readers of foreign formats raise anything for a damaged file
        raise BusError(f"traffic log {path} is damaged: {type(error).__name__}: {error}") from error
    return sorted(frames, key=lambda seen: (seen.at, not seen.sent))


class Reassembly:
    """ISO-TP messages of one arbitration id, from its frames. A message that lacks a frame is dropped."""

    def __init__(self) -> None:
        self._found = bytearray()
        self._length = 0
        self._next = 0

    def take(self, data: bytes) -> bytes | None:
        """The message that ends with this frame, if one does; flow control is none."""
        kind, low = data[0] >> 4, data[0] & 0xF
        if kind == SINGLE:
            self._length = 0
            return data[1 : 1 + low]
        if kind == FIRST:
            self._length = low << 8 | data[1]
            self._found, self._next = bytearray(data[2:]), 1
            return None
        if kind != CONSECUTIVE or self._length == 0:
            return None
        if low != self._next:
            self._length = 0
            return None
        self._found += data[1:]
        self._next = (self._next + 1) % 16
        if len(self._found) < self._length:
            return None
        message, self._length = bytes(self._found[: self._length]), 0
        return message
