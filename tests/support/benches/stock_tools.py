"""Stock tools on a bench: python-can's slcan, can-isotp and udsoncan, unmodified."""

from __future__ import annotations

import subprocess
import threading
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from struct import pack, unpack
from typing import Any

import can
import isotp
import numpy as np
import udsoncan
from udsoncan.client import Client
from udsoncan.connections import PythonIsoTpConnection

from inkloop_hardware.protocol.codec import Codec
from inkloop_hardware.protocol.records import MasterAlive
from inkloop_hardware.protocol.records import pack as pack_frame
from inkloop_hardware.protocol.services import Bytes as Raw
from support.benches import node_bench

FULL = np.ones((9, 9), np.uint8)


@contextmanager
def process(program: Path, *arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The running bench and its channel."""
    running = subprocess.Popen([program, *arguments], stdout=subprocess.PIPE, text=True)
    assert running.stdout
    try:
        yield running, running.stdout.readline().strip()
    finally:
        running.kill()
        running.wait()
        running.stdout.close()


class Unplugged(can.Listener):
    """Takes note that the bus is gone: the process behind it was killed."""

    def __init__(self) -> None:
        self.reason: Exception | None = None

    def on_message_received(self, msg: can.Message) -> None:
        pass

    def on_error(self, exc: Exception) -> None:
        self.reason = exc


class Adapter:
    """One slcan adapter on the bench's bus, with a heartbeat and stock UDS clients."""

    def __init__(self, channel: str) -> None:
        self.bus = can.Bus(interface="slcan", channel=channel, bitrate=500000, sleep_after_open=0.0)
        self.unplugged = Unplugged()
        self.notifier = can.Notifier(self.bus, [self.unplugged])
        self.codec = Codec()
        self.over, self.first = threading.Event(), threading.Event()
        self.heart = threading.Thread(target=self._beat)
        self.heart.start()
        assert self.first.wait(600)

    def _beat(self) -> None:
        counter = 0
        alive = MasterAlive(lamp_enable=True, gate_enable=True, motion_enable=True, session=3, job=7)
        while not self.over.is_set() and not self.unplugged.reason:
            try:
                self.send(pack_frame(self.codec, alive, counter=counter))
            except can.CanOperationError as error:
                self.unplugged.reason = error
            counter = (counter + 1) % 15
            self.first.set()
            self.over.wait(0.05)

    def send(self, frame) -> None:
        self.bus.send(can.Message(arbitration_id=frame.arbitration_id, data=frame.data, is_extended_id=False))

    def client(self, node: int) -> Client:
        ids = isotp.Address(isotp.AddressingMode.Normal_11bits, txid=0x640 + 2 * node, rxid=0x641 + 2 * node)
        stack = isotp.NotifierBasedCanStack(self.bus, self.notifier, address=ids, params={"tx_padding": 0xCC})
        settings: Any = dict(udsoncan.configs.default_client_config)
        settings |= {"data_identifiers": {"default": Raw()}, "request_timeout": 600, "p2_timeout": 60}
        return Client(PythonIsoTpConnection(stack), config=settings)

    def close(self) -> None:
        self.over.set()
        self.heart.join()
        self.notifier.stop()
        with suppress(can.CanOperationError):  # the process behind it may have been killed
            self.bus.shutdown()


@contextmanager
def adapter(channel: str) -> Iterator[Adapter]:
    made = Adapter(channel)
    try:
        yield made
    finally:
        made.close()


def start(client: Client, routine: int, option: bytes = b"", *, layer: int = 1, which: int = 0) -> int:
    """Outcome of a routine."""
    key = pack(">IHBB", 7, layer, which, 1)
    return client.start_routine(routine, key + option).service_data.routine_status_record[0]


def send_pattern(client: Client, blob: bytes, layer: int) -> None:
    place = udsoncan.MemoryLocation(layer, len(blob), address_format=32, memorysize_format=32)
    client.request_download(place)
    for number, at in enumerate(range(0, len(blob), 4000), start=1):
        client.transfer_data(number % 256, blob[at : at + 4000])
    assert client.request_transfer_exit(pack(">I", zlib.crc32(blob))).data == pack(">I", zlib.crc32(blob))


def read_map(client: Client, layer: int) -> bytes:
    size = unpack(">I", client.read_data_by_identifier(0x0103).service_data.values[0x0103][:4])[0]
    client.request_upload(udsoncan.MemoryLocation(layer, size, address_format=32, memorysize_format=32))
    found, number = b"", 0
    while len(found) < size:
        number += 1
        found += client.transfer_data(number % 256).service_data.parameter_records
    assert client.request_transfer_exit().data == pack(">I", zlib.crc32(found))
    return found


def print_and_scan(head: Client, lamp: Client, profiler: Client) -> None:
    """The first layer, full, in four passes, each cured; then its scan."""
    for client in (head, lamp, profiler):
        assert start(client, node_bench.Routine.CLEAR, b"\0") == node_bench.DONE
    send_pattern(head, node_bench.pattern_blob(FULL), 1)
    for number in range(4):
        assert start(head, node_bench.Routine.PASS, bytes([number]), which=number) == node_bench.DONE
        assert start(lamp, node_bench.Routine.CURE, pack(">H", 20), which=number) == node_bench.DONE
    assert start(profiler, node_bench.Routine.SCAN) == node_bench.DONE
