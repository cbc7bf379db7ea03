"""Serial CAN adapters (slcan, LAWICEL lines) read in bulk.

python-can's own class takes one byte per read, 16 to 20 kB/s, and a malformed line ends its reading with an IndexError.
Here a read takes all available bytes, and a malformed line is counted. Frames of CAN FD have the lines d, D, b and B of
the CANable 2.0.
"""

from __future__ import annotations

import os
import select
import time
from collections import deque
from typing import Any

import can
from can.interfaces.slcan import slcanBus
from can.util import dlc2len, len2dlc

READ_AT_ONCE = 1 << 16
LINE_MAX = 160
"""Bytes; the longest line, of a CAN FD frame with a time stamp, has 142."""
WRITE_TIMEOUT = 1.0
"""Seconds for a line to leave."""
TIME_STAMP = 4
"""Hexadecimal digits that some adapters put behind a frame."""
BEL = 7
CLASSIC, FD, SWITCHED, REMOTE = b"tT", b"dD", b"bB", b"rR"
"""First byte of the line of a frame with 11 or 29 bits: classic, CAN FD, that with bit-rate switch, remote."""
BUS_OFF_AFTER_S, BUS_OFF_REFUSALS = 0.15, 2
"""An adapter that refuses this many frames over this time, and confirms and receives none, is bus-off; a full buffer
refuses too, but frames come in meanwhile."""


class BulkSlcanBus(slcanBus):
    """An slcan adapter on a serial port, a terminal or `socket://host:port`.

    malformed: lines that are neither a frame nor an answer; refused: commands or frames that the adapter answered with
    BEL, counted from the first frame on (many adapters refuse the commands that open them). fd: frames of CAN FD are
    read, otherwise their lines are malformed; data_bitrate: 2000000 or 5000000 bit/s.
    """

    def __init__(self, channel: str, *, fd: bool = False, data_bitrate: int | None = None, **options: Any) -> None:
        self.begin_reading(fd=fd)
        self._data_bitrate = data_bitrate
        if channel.startswith("socket://"):
            options.setdefault("sleep_after_open", 0.0)
        super().__init__(channel, **options)
        self.serialPortOrig.write_timeout = WRITE_TIMEOUT
        self._selectable = os.name == "posix"

    def set_bitrate(self, bitrate: int, data_bitrate: int | None = None) -> None:
        """Set both bit rates [bit/s]; called while it opens."""
        super().set_bitrate(bitrate, data_bitrate or self._data_bitrate)

    def begin_reading(self, *, fd: bool = False) -> None:
        """Reset the state of reading."""
        self._heads = CLASSIC + REMOTE + (FD + SWITCHED if fd else b"")
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
        heads = CLASSIC if not msg.is_fd else SWITCHED if msg.bitrate_switch else FD
        digits = 8 if msg.is_extended_id else 3
        head = f"{heads[msg.is_extended_id]:c}{msg.arbitration_id:0{digits}X}{len2dlc(len(msg.data)):X}"
        with can.exceptions.error_check("Could not write to serial device"):
            self.serialPortOrig.write(f"{head}{msg.data.hex().upper()}\r".encode())

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
        is_frame = line[:1] != b"" and line[:1] in self._heads
        if is_frame or line[:1] in (b"z", b"Z"):
            self._refused_since, self._refusals_in_a_row = None, 0
        if not is_frame:
            self.malformed += bool(line) and line[:1] not in b"zZVNF"  # answers of the adapter
            return
        try:
            self.waiting.append(frame_of(line, now))
            self._heard = True
        except ValueError:
            self.malformed += 1


def frame_of(line: bytes, now: float) -> can.Message:
    """Frame of a line without its end; ValueError for one that is malformed. `now`: its time stamp [s]."""
    extended, remote, fd = line[:1].isupper(), line[:1] in REMOTE, line[:1] in FD + SWITCHED
    at = 9 if extended else 4
    length = dlc2len(int(line[at : at + 1], 16)) if fd else int(line[at : at + 1])
    digits = 0 if remote else 2 * length
    if not line.isalnum():
        raise ValueError(f"line {line!r} contains other characters than digits")
    if (length > 8 and not fd) or len(line) - at - 1 - digits not in (0, TIME_STAMP):
        raise ValueError(f"line {line!r} has another length than its digit")
    identifier = int(line[1:at], 16)
    if identifier >= 1 << (29 if extended else 11):
        raise ValueError(f"line {line!r} has an id beyond the range of its frame")
    data = None if remote else bytes.fromhex(line[at + 1 : at + 1 + digits].decode("ascii"))
    message = can.Message(now, identifier, extended, remote, dlc=length, data=data, is_fd=fd)
    message.bitrate_switch = line[:1] in SWITCHED
    return message
