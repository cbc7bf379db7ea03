"""Services of a peer on the bus of a mapped rig: standard UDS over ISO-TP."""

from __future__ import annotations

import logging
import zlib
from collections.abc import Callable
from typing import Any

import udsoncan
from udsoncan import MemoryLocation
from udsoncan.client import Client
from udsoncan.exceptions import NegativeResponseException, TimeoutException

from inkloop_hardware.bus.isotp_connection import IsoTpConnection, Wire
from inkloop_hardware.errors import LinkTimeout, NodeRefused, TransferError
from inkloop_hardware.link.transfers import BLOCK_MOST
from inkloop_hardware.protocol.codec import id_text
from inkloop_hardware.protocol.services import POSITIVE, ROUTINE_CONTROL, UNREADABLE, Bytes
from inkloop_hardware.protocol.services import is_answer as is_answer_of_a_node

TRIES = 3
P2_STAR = 6.0
"""Seconds between two "still busy" (0x78)."""


class Peer:
    """Services of one peer. A request without an answer is repeated, except a routine."""

    def __init__(self, name: str, wire: Wire, request: int, answer: int, answer_s: float, *, fd: bool = False) -> None:
        self.name = f"{name} ({id_text(request)}, {id_text(answer)})"
        self._wire = wire
        self._connection = IsoTpConnection(wire, request, answer, is_answer, fd=fd)
        config: Any = dict(udsoncan.configs.default_client_config)
        config |= {"data_identifiers": {"default": Bytes()}, "request_timeout": None, "use_server_timing": False}
        config |= {"p2_timeout": answer_s, "p2_star_timeout": P2_STAR}
        self._client = Client(self._connection, config=config)
        self._client.logger.setLevel(logging.WARNING)

    def read(self, identifier: int) -> bytes:
        """0x22: the bytes of an identifier."""
        answer = self._again(
            f"identifier 0x{identifier:04X} (0x22)", lambda: self._client.read_data_by_identifier(identifier)
        )
        data: bytes = answer.service_data.values[identifier]
        return data

    def routine(self, routine: int, option: bytes, limit_s: float) -> bytes:
        """0x31 01: the record of its answer. After LinkTimeout it is unknown whether the routine was done."""
        what = f"routine 0x{routine:04X} (0x31)"
        self._connection.deadline = self._wire.now() + limit_s
        try:
            answer = self._asked(what, lambda: self._client.start_routine(routine, option))
        except LinkTimeout as error:
            is_busy = self._wire.now() > self._connection.deadline
            why = f"{self.name} was still busy with {what} after {limit_s:g} s, the limit_s of its step"
            unknown = "Whether it was done is unknown: check the rig before you continue"
            raise LinkTimeout(f"{why if is_busy else error}. {unknown}") from error
        finally:
            self._connection.deadline = None
        record: bytes = answer.service_data.routine_status_record
        return record

    def download(self, place: MemoryLocation, blob: bytes, crc: bool) -> None:
        """0x34, 0x36, 0x37; after an error again from the beginning."""
        self._again("download (0x34, 0x36, 0x37)", lambda: self._download(place, blob, crc))

    def upload(self, place: MemoryLocation, size: int, crc: bool) -> bytes:
        """0x35, 0x36, 0x37; after an error again from the beginning."""
        data: bytes = self._again("upload (0x35, 0x36, 0x37)", lambda: self._upload(place, size, crc))
        return data

    def _download(self, place: MemoryLocation, blob: bytes, crc: bool) -> None:
        opened: Any = self._client.request_download(place)
        block = min(opened.service_data.max_length, BLOCK_MOST) - 2
        if block < 1:
            raise TransferError(f"{self.name} takes blocks of {block + 2} bytes; needs 3 at least, two are their head")
        for number, at in enumerate(range(0, len(blob), block), 1):
            self._client.transfer_data(number % 256, blob[at : at + block])
        self._client.request_transfer_exit(zlib.crc32(blob).to_bytes(4, "big") if crc else None)

    def _upload(self, place: MemoryLocation, size: int, crc: bool) -> bytes:
        self._client.request_upload(place)
        data, number = b"", 0
        while len(data) < size:
            number += 1
            answer: Any = self._client.transfer_data(number % 256)
            piece = answer.service_data.parameter_records
            if not piece:
                break
            data += piece
        end: Any = self._client.request_transfer_exit()
        record = end.service_data.parameter_records
        if crc and record != zlib.crc32(data).to_bytes(4, "big"):
            raise TransferError(f"{self.name}: the checksum of the upload differs; bytes were altered on the way")
        return data

    def _again(self, what: str, ask: Callable[[], Any]) -> Any:
        for _ in range(TRIES - 1):
            try:
                return self._asked(what, ask)
            except (LinkTimeout, TransferError):
                self._wire.check()
        return self._asked(what, ask)

    def _asked(self, what: str, ask: Callable[[], Any]) -> Any:
        try:
            return ask()
        except TimeoutException as error:
            raise LinkTimeout(f"no answer of {self.name}: {what}; is it powered, and are these its ids?") from error
        except NegativeResponseException as error:
            code, name = error.response.code or 0, error.response.code_name
            raise NodeRefused(f"{self.name} refuses: {what}: {name} (0x{code:02X})", code) from error
        except UNREADABLE as error:
            raise TransferError(f"{self.name} answers what cannot be read: {what}: {error}") from error


def is_answer(request: bytes, message: bytes) -> bool:
    """Whether a message answers this request, by its first bytes; routines of others have no keys."""
    if message[:1] == bytes([ROUTINE_CONTROL + POSITIVE]):
        return message[:4] == bytes([request[0] + POSITIVE]) + request[1:4]
    return is_answer_of_a_node(request, message)
