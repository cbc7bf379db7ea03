"""Nodes that answer as in a recorded run, and detect requests that differ from it.

Requests that the part depends on must come in the order of the log: patterns, moves, passes, cures, scans and maps. All
others may be repeated or omitted.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from struct import pack

from inkloop_hardware.errors import BusError, HardwareError, NodeLost, ReplayDiffers, ReplayEnded
from inkloop_hardware.protocol.node_state import Identifier
from inkloop_hardware.protocol.records import Node
from inkloop_hardware.protocol.services import Key, Routine
from inkloop_hardware.protocol.transfer_bytes import first_difference, plain_form
from inkloop_hardware.replay.recorded_exchanges import (
    BLOCK,
    DOWNLOAD,
    EXIT,
    POSITIVE,
    READ,
    ROUTINE,
    TESTER_PRESENT,
    UPLOAD,
    Exchange,
)

CODED = 0x10
SHOWN_BYTES = 16


@dataclass
class _Transfer:
    """A transfer of a pattern or a map, in blocks of any size; `done`: the bytes so far."""

    whole: Exchange
    request: bytes
    block: int
    done: bytearray = field(default_factory=bytearray)
    last: bytes = b""


class RecordedNodes:
    """The four nodes of a log. found: `exchanges` of it; log: named in errors. Raises BusError for a log of no run.

    begins: indices of the first frames of resumed runs.
    """

    def __init__(self, found: Sequence[Exchange], log: Path, begins: Sequence[int] = ()) -> None:
        keys = (one.request[4:12] for one in found if one.request[0] == ROUTINE and len(one.request) >= 12)
        first = next(keys, None)
        if first is None:
            raise BusError(f"{log}: contains no request to a node; is it the traffic of a run on a bench?")
        self.job = Key.of(first).job
        self.first = found[0].at
        self._found, self._log, self._begins = found, log, begins
        self._next = 0
        self._known: dict[tuple[Node, bytes], bytes] = {}
        self._transfers: dict[Node, _Transfer] = {}

    def answer(self, node: Node, request: bytes) -> tuple[bytes, int]:
        """The answer to a request, and the index of the frame of the log up to which it advances time.

        Raises ReplayDiffers, ReplayEnded, and NodeLost where the recorded run lost the node, or was resumed.
        """
        service, transfer = request[0], self._transfers.get(node)
        if service == TESTER_PRESENT:
            return bytes([TESTER_PRESENT + POSITIVE, 0]), -1
        if transfer is not None and service in (BLOCK, EXIT):
            answer = self._block(transfer, request) if service == BLOCK else self._end(transfer, request)
            return answer, transfer.whole.at if service == EXIT else -1
        found = self._matching(node, request)
        if found is None:
            known = self._known.get((node, request))
            if known is None:
                raise self._difference(node, request)
            return known, -1
        self._next = self._found.index(found, self._next) + 1
        if not found.answer:
            raise NodeLost(f"{self._log}: as in the recorded run, no answer of the {described(node, request)}")
        self._known[node, request] = found.answer
        if found.blob is None:
            return found.answer, found.at
        self._transfers[node] = _Transfer(found, request, int.from_bytes(found.answer[2:4], "big"))
        return found.answer, -1

    def _matching(self, node: Node, request: bytes) -> Exchange | None:
        """The next exchange of the log that answers it, without omitting one that the part depends on."""
        for one in self._found[self._next :]:
            if one.node is node and (one.request == request or _is_same_pattern(one, request)):
                return one
            if one.is_of_a_layer:
                return None
        return None

    def _block(self, transfer: _Transfer, request: bytes) -> bytes:
        head = bytes([BLOCK + POSITIVE, request[1]])
        if request[1:2] == transfer.last[1:2]:  # a repeat
            return transfer.last
        if transfer.request[0] == DOWNLOAD:
            transfer.done += request[2:]
            transfer.last = head
        else:
            most = int.from_bytes(request[2:4], "big") if len(request) >= 4 else transfer.block
            at = len(transfer.done)
            piece = (transfer.whole.blob or b"")[at : at + most - len(head)]
            transfer.done += piece
            transfer.last = head + piece
        return transfer.last

    def _end(self, transfer: _Transfer, request: bytes) -> bytes:
        if transfer.request[0] == DOWNLOAD:
            ours = plain_form(bytes(transfer.done), bool(transfer.request[1] & CODED))
            theirs = plain_form(transfer.whole.blob or b"", bool(transfer.whole.request[1] & CODED))
            if ours != theirs:
                raise ReplayDiffers(f"{self._log}: {_pattern_difference(_layer(transfer.request), ours, theirs)}")
            return pack(">BI", EXIT + POSITIVE, zlib.crc32(transfer.done))
        return transfer.whole.end

    def _difference(self, node: Node, request: bytes) -> HardwareError:
        """The error for a request that the log does not have next; at a resumed run the replay continues with that."""
        asked = f"the master asks the {described(node, request)}"
        expected = next((one for one in self._found[self._next :] if one.is_of_a_layer), None)
        before = self._found[self._next - 1].at if self._next else 0
        resumed = [begin for begin in self._begins if before < begin <= (expected.at if expected else before)]
        if resumed:
            self._next = next(k for k, one in enumerate(self._found) if one.at >= resumed[0])
            return NodeLost(f"{self._log}: as in the recorded run, the master is interrupted here and resumed")
        if expected is None:
            return ReplayEnded(f"{self._log} ends here: {asked}, and the recorded run has no further request")
        pairs = enumerate(zip(request, expected.request, strict=False))
        at = next((at for at, (one, other) in pairs if one != other), min(len(request), len(expected.request)))
        return ReplayDiffers(
            f"{self._log}: {asked}, in the log comes the {described(expected.node, expected.request)}; their first "
            f"differing byte is {at}: {request[:SHOWN_BYTES].hex(' ')}, in the log "
            f"{expected.request[:SHOWN_BYTES].hex(' ')}"
        )


def described(node: Node, request: bytes) -> str:
    """A request as part of a sentence: "head for pass of layer 7, pass 1"."""
    service, name = request[0], node.lower()
    if service == ROUTINE and len(request) >= 12:
        number = int.from_bytes(request[2:4], "big")
        routine = Routine(number).name.lower().replace("_", " ") if number in set(Routine) else f"routine {number:04X}"
        return f"{name} for {routine} of {Key.of(request[4:12])}"
    if service in (DOWNLOAD, UPLOAD):
        return f"{name} to {'take the pattern' if service == DOWNLOAD else 'give the map'} of layer {_layer(request)}"
    if service == READ:
        number = int.from_bytes(request[1:3], "big")
        known = Identifier(number).name.lower() if number in set(Identifier) else "unknown"
        return f"{name} for identifier {number:04X} ({known})"
    return f"{name} with {request[:SHOWN_BYTES].hex(' ')}"


def _is_same_pattern(one: Exchange, request: bytes) -> bool:
    """A pattern of that layer in any form and size: the bytes are compared at the end of the transfer."""
    is_download = one.request[0] == request[0] == DOWNLOAD and one.blob is not None
    return is_download and _layer(one.request) == _layer(request)


def _layer(request: bytes) -> int:
    return int.from_bytes(request[3:7], "big")


def _pattern_difference(layer: int, ours: bytes, theirs: bytes) -> str:
    at = next((at for at, (one, other) in enumerate(zip(ours, theirs, strict=False)) if one != other), None)
    if at is None:
        return f"the pattern of layer {layer} has {len(ours)} bytes, in the log {len(theirs)}"
    cell = first_difference(ours, theirs)
    where = f" (cell {cell[0]}, {cell[1]})" if cell else " (its head: grid, passes or materials)"
    return f"the pattern of layer {layer} differs at byte {at}{where}: 0x{ours[at]:02X}, in the log 0x{theirs[at]:02X}"
