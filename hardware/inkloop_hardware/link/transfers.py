"""Transfer of patterns to a node and of maps from it, in blocks that shrink after lost frames."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from struct import pack
from typing import Any

from udsoncan import DataFormatIdentifier, MemoryLocation

from inkloop_hardware.errors import LinkTimeout, NodeRefused, TransferError
from inkloop_hardware.link.requests import TRIES, Requests
from inkloop_hardware.protocol.node_state import Identifier, MapSize, TransferFlags, TransferState
from inkloop_hardware.protocol.transfer_bytes import CELLS_MAX, map_size

Progress = Callable[[int, int], None]
"""Called with the bytes transferred so far and the bytes in all."""

BLOCK_FLOOR = 256
"""Bytes of the smallest block, its head included."""
BLOCK_HEAD = 2
BLOCK_MOST = 4095
"""Bytes that ISO-TP carries in one message."""
GROW_AFTER = 8
"""Blocks in a row without a retry after which blocks double again."""
BROKEN = (0x24, 0x31, 0x71, 0x72, 0x73)
"""Refusals in the middle of a transfer after which it may begin again; 0x31: a byte was altered to a value that no
pattern contains."""


class BlockSize:
    """Bytes that a block may carry: halved by a retry, doubled after several blocks without one."""

    def __init__(self, most: int) -> None:
        self._most = min(most, BLOCK_MOST) - BLOCK_HEAD
        self._floor = min(self._most, BLOCK_FLOOR - BLOCK_HEAD)
        self._good = 0
        self.bytes = self._most

    @property
    def is_whole(self) -> bool:
        """Whether blocks have their full size."""
        return self.bytes == self._most

    def went_through(self) -> None:
        """Note a block that was transferred at the first try."""
        self._good += 1
        if self._good % GROW_AFTER == 0:
            self.bytes = min(self._most, 2 * self.bytes)

    def was_lost(self) -> None:
        """Note a block that was lost, or its answer."""
        self._good = 0
        self.bytes = max(self._floor, self.bytes // 2)


def send_pattern(requests: Requests, layer: int, blob: bytes, coded: bool, progress: Progress | None) -> None:
    """Download a pattern (0x34, 0x36, 0x37); TransferError if the node has other bytes at the end."""
    what = f"pattern of layer {layer} (0x34)"
    form = DataFormatIdentifier(compression=1 if coded else 0)
    answer = requests.request(what, requests.client.request_download, _place(layer, len(blob)), form)
    size = _block_size(requests, what, answer)
    at, number = 0, 1
    while at < len(blob):
        at += _send_block(requests, layer, number, blob, at, size)
        number += 1
        if progress:
            progress(at, len(blob))
    expected = zlib.crc32(blob)
    what = f"end of the pattern of layer {layer} (0x37)"
    found = _within(requests, what, requests.client.request_transfer_exit, pack(">I", expected))
    if found.service_data.parameter_records != pack(">I", expected):
        raise TransferError(f"the {requests.name} has another checksum: {what}")


def receive_map(requests: Requests, layer: int, progress: Progress | None) -> bytes:
    """Upload a map (0x35, 0x36, 0x37); TransferError if it is short or altered."""
    size_of_map = requests.read(Identifier.MAP, MapSize.of)
    nx, ny, total = size_of_map.nx, size_of_map.ny, size_of_map.size
    if total not in (0, map_size(nx, ny)) or nx * ny > CELLS_MAX:
        raise TransferError(f"the {requests.name} reports {total} bytes for its map of {nx} x {ny} cells")
    if total == 0:
        message = f"the {requests.name} has no map of layer {layer}: nothing was scanned since its power-up"
        raise NodeRefused(message, 0x24)
    what = f"map of layer {layer} (0x35)"
    answer = requests.request(what, requests.client.request_upload, _place(layer, total))
    size = _block_size(requests, what, answer)
    found, number = bytearray(), 1
    while len(found) < total:
        found += _fetch_block(requests, layer, number, size)
        number += 1
        if progress:
            progress(len(found), total)
    what = f"end of the map of layer {layer} (0x37)"
    end = _within(requests, what, requests.client.request_transfer_exit)
    if len(found) != total or end.service_data.parameter_records != pack(">I", zlib.crc32(found)):
        raise TransferError(f"the map of layer {layer} from the {requests.name} was altered; scan once more")
    return bytes(found)


def _send_block(requests: Requests, layer: int, number: int, blob: bytes, at: int, size: BlockSize) -> int:
    """Send a block; the bytes of it that the node took. Before a repeat the node is asked how many it has."""
    what = f"block {number} of the pattern of layer {layer} (0x36)"
    before = requests.spoilt
    for attempt in range(TRIES):
        piece = blob[at : at + size.bytes]
        try:
            _within(requests, what, requests.client.transfer_data, number % 256, piece, tries=1)
        except LinkTimeout:
            size.was_lost()
        else:
            if attempt == 0:
                size.went_through()
            return len(piece)
        taken = requests.read(Identifier.TRANSFER, TransferState.of)
        is_active = TransferFlags.ACTIVE in taken.flags
        if is_active and taken.done == at + len(piece):
            return len(piece)
        if not is_active or taken.done != at:
            raise TransferError(f"the {requests.name} has {taken.done} bytes, expected {at}: {what}")
    raise LinkTimeout(_in_vain(requests, "took nothing", what, before))


def _fetch_block(requests: Requests, layer: int, number: int, size: BlockSize) -> bytes:
    """Fetch the next block; a repeat asks for fewer bytes of it."""
    what = f"block {number} of the map of layer {layer} (0x36)"
    before = requests.spoilt
    for attempt in range(TRIES):
        most = None if attempt == 0 and size.is_whole else pack(">H", size.bytes)
        try:
            answer = _within(requests, what, requests.client.transfer_data, number % 256, most, tries=1)
        except LinkTimeout:
            size.was_lost()
            continue
        piece: bytes = answer.service_data.parameter_records or b""
        if not piece:
            raise TransferError(f"the {requests.name} sent an empty block: {what}")
        if attempt == 0:
            size.went_through()
        return piece
    raise LinkTimeout(_in_vain(requests, "sent nothing", what, before))


def _in_vain(requests: Requests, did: str, what: str, before: int) -> str:
    """Message about a block that did not cross; before: `spoilt` at its first try."""
    spoilt = requests.spoilt_frames(before)
    whole = " whole" * bool(spoilt)
    return f"the {requests.name} {did}{whole} in {TRIES} tries: {what}; {spoilt or 'check cables and termination'}"


def _block_size(requests: Requests, what: str, answer: Any) -> BlockSize:
    most = answer.service_data.max_length
    if most <= BLOCK_HEAD:
        raise TransferError(
            f"the {requests.name} takes blocks of {most} bytes, expected more than {BLOCK_HEAD}, their head: {what}"
        )
    return BlockSize(most)


def _within(requests: Requests, what: str, service: Callable[..., Any], *arguments: object, tries: int = TRIES) -> Any:
    """Request in the middle of a transfer: a refusal because the two ends differ becomes a TransferError."""
    try:
        return requests.request(what, service, *arguments, tries=tries)
    except NodeRefused as error:
        if error.code in BROKEN:
            raise TransferError(str(error)) from error
        raise


def _place(layer: int, size: int) -> MemoryLocation:
    """The address of a layer."""
    return MemoryLocation(layer, size, address_format=32, memorysize_format=32)
