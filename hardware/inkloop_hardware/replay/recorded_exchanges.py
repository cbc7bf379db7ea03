"""Exchanges of a traffic log: its frames, their ISO-TP messages, requests with their answers, patterns and maps.

Retries, late answers and "still busy" are removed: both sides acted on the rest.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path
from struct import unpack_from
from typing import NamedTuple

import can

from inkloop.files import regular
from inkloop_hardware.bus.adapter import data_frame
from inkloop_hardware.bus.traffic_log import WRITERS
from inkloop_hardware.errors import BusError
from inkloop_hardware.protocol.codec import Codec, Frame
from inkloop_hardware.protocol.node_state import TransferState
from inkloop_hardware.protocol.records import Node
from inkloop_hardware.protocol.services import Routine, is_answer

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
        with can.LogReader(regular(path), relative_timestamp=False) as log:  # ASC only: BLF takes no notice of it
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


READ, ROUTINE, DOWNLOAD, UPLOAD, BLOCK, EXIT = 0x22, 0x31, 0x34, 0x35, 0x36, 0x37
TESTER_PRESENT = 0x3E
POSITIVE, NEGATIVE, STILL_BUSY = 0x40, 0x7F, 0x78
OF_A_LAYER = frozenset({Routine.PASS, Routine.CURE, Routine.SCAN, Routine.MOVE})


@dataclass
class Asked:
    """A request of the master; answer: the one it accepted, None without one; at: index of the last frame."""

    node: Node
    request: bytes
    at: int
    answer: bytes | None = None


@dataclass(frozen=True)
class Exchange:
    """A request and its answer; of a pattern or a map also all its bytes and the answer to its end.

    answer: empty for a step that was not requested again: the node was lost, or the master.
    """

    node: Node
    request: bytes
    answer: bytes
    at: int
    blob: bytes | None = None
    end: bytes = b""

    @property
    def is_of_a_layer(self) -> bool:
        """Whether the part depends on it: a missing or a different one makes another print."""
        return self.request[0] in (DOWNLOAD, UPLOAD) or is_step(self.request)


def exchanges(seen: Sequence[Seen], codec: Codec) -> list[Exchange]:
    """All answered exchanges, in the order of their ends, without transfers that were restarted at once."""
    asked = list(_asked(seen, codec))
    by_node = ([one for one in asked if one.node is node and one.request[0] != TESTER_PRESENT] for node in Node)
    found = [exchange for of_one in by_node for exchange in _folded(of_one)]
    return sorted(found, key=lambda exchange: exchange.at)


def _asked(seen: Iterable[Seen], codec: Codec) -> Iterator[Asked]:
    """Requests in their order, each with the answer that came before the next one."""
    ways = {codec.request_id(node): (node, Reassembly()) for node in Node}
    back = {codec.answer_id(node): (node, Reassembly()) for node in Node}
    waiting: dict[Node, Asked] = {}
    for at, (_, _, (identifier, data, _)) in enumerate(seen):
        if not data:
            continue
        if identifier in ways:
            node, way = ways[identifier]
            if request := way.take(data):
                if node in waiting:
                    yield waiting[node]
                waiting[node] = Asked(node, request, at)
        elif identifier in back:
            node, way = back[identifier]
            answer, one = way.take(data), waiting.get(node)
            is_busy = answer is not None and answer[:1] == bytes([NEGATIVE]) and answer[2:3] == bytes([STILL_BUSY])
            if answer and one and one.answer is None and not is_busy and is_answer(one.request, answer):
                one.answer, one.at = answer, at
    yield from waiting.values()


@dataclass
class _Transfer:
    """An unfinished transfer of a pattern or a map."""

    begin: Asked
    found: bytearray = field(default_factory=bytearray)
    unsure: bytes = b""
    """a block of a pattern without an answer, which may have arrived"""

    def take(self, one: Asked) -> None:
        """Take a block, or the answer of the node about the progress of the transfer."""
        if one.request[0] == BLOCK and self.begin.request[0] == DOWNLOAD:
            self.unsure = b"" if one.answer else one.request[2:]
            self.found += one.request[2:] if _is_good(one) else b""
        elif one.request[0] == BLOCK and _is_good(one):
            self.found += (one.answer or b"")[2:]
        elif one.request[:3] == b"\x22\x01\x04" and one.answer and self.unsure:
            arrived = TransferState.of(one.answer[3:]).done == len(self.found) + len(self.unsure)
            self.found += self.unsure if arrived else b""

    def ended(self, one: Asked) -> Exchange | None:
        """The whole transfer, if its end was confirmed."""
        checksum = (one.answer or b"")[1:5]
        if not _is_good(one) or len(checksum) < 4 or unpack_from(">I", checksum)[0] != zlib.crc32(self.found):
            return None
        answer, end = self.begin.answer or b"", one.answer or b""
        return Exchange(one.node, self.begin.request, answer, one.at, bytes(self.found), end)


def _folded(asked: Sequence[Asked]) -> Iterator[Exchange]:
    """Exchanges of one node, with the blocks of a transfer joined; lost ones too, if not requested again at once."""
    transfer: _Transfer | None = None
    for one, later in zip_longest(asked, asked[1:]):
        service = one.request[0]
        if transfer is not None and service not in (BLOCK, EXIT, READ):
            if service != transfer.begin.request[0]:
                yield _lost(transfer.begin)
            transfer = None
        if service in (DOWNLOAD, UPLOAD) and _is_good(one):
            transfer = _Transfer(one)
        elif service == EXIT and transfer is not None:
            if (whole := transfer.ended(one)) is not None:
                yield whole
                transfer = None
        elif transfer is not None and (service == BLOCK or one.request[:3] == b"\x22\x01\x04"):
            transfer.take(one)
        elif one.answer and service not in (BLOCK, EXIT):
            yield Exchange(one.node, one.request, one.answer, one.at)
        elif is_step(one.request) and (later is None or later.request != one.request):
            yield _lost(one)
    if transfer is not None:
        yield _lost(transfer.begin)


def _lost(one: Asked) -> Exchange:
    return Exchange(one.node, one.request, b"", one.at)


def is_step(request: bytes) -> bool:
    """Whether it starts a step of a layer."""
    return request[:2] == bytes([ROUTINE, 1]) and int.from_bytes(request[2:4], "big") in OF_A_LAYER


def _is_good(one: Asked) -> bool:
    return one.answer is not None and one.answer[:1] != bytes([NEGATIVE])
