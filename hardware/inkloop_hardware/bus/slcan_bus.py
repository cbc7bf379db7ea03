"""Serial CAN adapters (slcan, LAWICEL lines) read in bulk.

python-can's own class takes one byte per read, 16 to 20 kB/s, and a malformed line ends its reading with an IndexError.
Here a read takes all available bytes, and a malformed line is counted. Classic frames only.
"""

from __future__ import annotations

import os
import select
import time
from collections import deque
from typing import Any

import can
from can.interfaces.slcan import slcanBus

READ_AT_ONCE = 1 << 16
LINE_MAX = 64
"""Bytes; the longest line of a classic frame has 30 with a time stamp."""
WRITE_TIMEOUT = 1.0
"""Seconds for a line to leave."""
TIME_STAMP = 4
"""Hexadecimal digits that some adapters put behind a frame."""
BEL = 7
BUS_OFF_AFTER_S, BUS_OFF_REFUSALS = 0.15, 2
"""An adapter that refuses this many frames over this time, and confirms and receives none, is bus-off; a full buffer
refuses too, but frames come in meanwhile."""


class BulkSlcanBus(slcanBus):
    """An slcan adapter on a serial port, a terminal or `socket://host:port`.

    malformed: lines that are neither a frame nor an answer; refused: commands or frames that the adapter answered with
    BEL, counted from the first frame on (many adapters refuse the commands that open them).
    """

    def __init__(self, channel: str, **options: Any) -> None:
        self.begin_reading()
        if channel.startswith("socket://"):
            options.setdefault("sleep_after_open", 0.0)
        super().__init__(channel, **options)
        self.serialPortOrig.write_timeout = WRITE_TIMEOUT
        self._selectable = os.name == "posix"

    def begin_reading(self) -> None:
        """Reset the state of reading."""
        self.malformed = 0
        self.refused = 0
        self._refused_since: float | None = None
        self._refusals_in_a_row = 0
        self.waiting: deque[can.Message] = deque()
        self._rest = b""
        self._overlong = False
        self._heard = False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Write one line; CanOperationError if it cannot be written within WRITE_TIMEOUT."""
        head = f"T{msg.arbitration_id:08X}" if msg.is_extended_id else f"t{msg.arbitration_id:03X}"
        with can.exceptions.error_check("Could not write to serial device"):
            self.serialPortOrig.write(f"{head}{msg.dlc:d}{msg.data.hex().upper()}\r".encode())

    @property
    def bus_off_since(self) -> float | None:
        """Second of the monotonic clock since which it is off the bus, None if it is on it."""
        since = self._refused_since
        if since is None or self._refusals_in_a_row < BUS_OFF_REFUSALS or time.monotonic() - since <= BUS_OFF_AFTER_S:
            return None
        return since

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self.waiting:
            self.take(self._read_bytes(timeout))
        return (self.waiting.popleft() if self.waiting else None), False

    def _read_bytes(self, timeout: float | None) -> bytes:
        port = self.serialPortOrig
        with can.exceptions.error_check("Could not read from serial device"):
            if not self._selectable:
                return bytes(port.read(max(1, port.in_waiting)))
            if not select.select([port.fileno()], [], [], timeout)[0]:
                return b""
            try:
                found = os.read(port.fileno(), READ_AT_ONCE)
            except BlockingIOError:
                return b""
            if not found:
                raise can.CanOperationError("the other side closed the connection")
            return found

    def take(self, found: bytes) -> None:
        """Move the frames of all complete lines to `waiting`; keep the rest."""
        if refusals := found.count(BEL):  # they stand alone, no line end follows
            found = found.replace(b"\a", b"")
            self._take_refusals(refusals)
        *lines, self._rest = (self._rest + found).split(b"\r")
        now = time.time()
        if self._overlong and lines:  # the end of a line whose beginning was dropped
            self._overlong = False
            del lines[0]
        for line in lines:
            if len(line) > LINE_MAX:
                self.malformed += 1
                continue
            self._take_line(line, now)
        if len(self._rest) > LINE_MAX:
            self.malformed += not self._overlong
            self._overlong, self._rest = True, b""

    def _take_refusals(self, count: int) -> None:
        if not self._heard:
            return
        self.refused += count
        self._refusals_in_a_row += count
        self._refused_since = self._refused_since or time.monotonic()

    def _take_line(self, line: bytes, now: float) -> None:
        if line[:1] in (b"t", b"T", b"r", b"R", b"z", b"Z"):
            self._refused_since, self._refusals_in_a_row = None, 0
        if line[:1] not in (b"t", b"T", b"r", b"R"):
            self.malformed += bool(line) and line[:1] not in b"zZVNF"  # answers of the adapter
            return
        try:
            self.waiting.append(frame_of(line, now))
            self._heard = True
        except ValueError:
            self.malformed += 1


def frame_of(line: bytes, now: float) -> can.Message:
    """Frame of a line without its end; ValueError for one that is malformed. `now`: its time stamp [s]."""
    extended, remote = line[:1] in b"TR", line[:1] in b"rR"
    at = 9 if extended else 4
    length = int(line[at : at + 1])
    digits = 0 if remote else 2 * length
    if not line.isalnum():
        raise ValueError(f"line {line!r} contains other characters than digits")
    if length > 8 or len(line) - at - 1 - digits not in (0, TIME_STAMP):
        raise ValueError(f"line {line!r} has another length than its digit")
    identifier = int(line[1:at], 16)
    if identifier >= 1 << (29 if extended else 11):
        raise ValueError(f"line {line!r} has an id beyond the range of its frame")
    data = None if remote else bytes.fromhex(line[at + 1 : at + 1 + digits].decode("ascii"))
    return can.Message(now, identifier, extended, remote, dlc=length, data=data)
