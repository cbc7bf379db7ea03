"""The emulated bench as a process of its own, driven by stock tools: python-can, can-isotp, udsoncan."""

from __future__ import annotations

import subprocess
import threading
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from struct import pack, unpack

import can
import isotp
import numpy as np
import pytest
import udsoncan
from udsoncan.client import Client
from udsoncan.connections import PythonIsoTpConnection

import node_bench
from inkloop_hardware.codec import Codec, Frame
from inkloop_hardware.records import MasterAlive, StopRequest
from inkloop_hardware.records import pack as pack_frame
from inkloop_hardware.vocabulary import Source

FULL = np.ones((9, 9), np.uint8)


class Raw(udsoncan.DidCodec):
    """An identifier as its bytes."""

    def encode(self, value: bytes) -> bytes:
        return value

    def decode(self, payload: bytes) -> bytes:
        return payload

    def __len__(self) -> int:
        raise udsoncan.DidCodec.ReadAllRemainingData


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return node_bench.build_process(tmp_path_factory.mktemp("bench"))


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
        assert self.first.wait(60)

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
        settings = dict(udsoncan.configs.default_client_config)
        settings |= {"data_identifiers": {"default": Raw()}, "request_timeout": 10, "p2_timeout": 5}
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


def test_stock_tools_print_cure_scan_and_read_the_journal(program: Path) -> None:
    with (
        process(program, "pass_ms=5") as (_, channel),
        adapter(channel) as bus,
        bus.client(0) as head,
        bus.client(2) as lamp,
        bus.client(3) as profiler,
        node_bench.NodeBench(pass_ms=5) as same,
    ):
        for client in (head, lamp, profiler):
            assert start(client, node_bench.CLEAR, b"\0") == node_bench.DONE
        send_pattern(head, node_bench.pattern_blob(FULL), 1)
        for number in range(4):
            assert start(head, node_bench.PASS, bytes([number]), which=number) == node_bench.DONE
            assert start(lamp, node_bench.CURE_ROUTINE, pack(">H", 20), which=number) == node_bench.DONE
        assert start(head, node_bench.PASS, b"\0") == node_bench.DONE_BEFORE
        assert start(profiler, node_bench.SCAN) == node_bench.DONE
        journal = head.read_data_by_identifier(0x0110).service_data.values[0x0110]
        assert [journal[at + 4] for at in range(0, len(journal), 40)] == [4, 3, 4, 3, 4, 3, 4, 3, 2, 1]
        same.ready().print_layer(FULL, 1)
        assert same.scan(1) == node_bench.DONE
        assert read_map(profiler, 1) == same.upload(1)


def test_every_adapter_sees_the_frames_of_all_nodes_and_the_dbc_reads_them(program: Path) -> None:
    """Also those of the other adapters."""
    with process(program) as (_, channel), adapter(channel), adapter(channel) as other:
        seen = can.BufferedReader()
        other.notifier.add_listener(seen)
        missing = {0x020, *range(0x101, 0x105), *range(0x111, 0x115)}
        while missing:
            message = seen.get_message(10)
            assert message, f"no frame of {missing}"
            missing.discard(message.arbitration_id)
            if message.arbitration_id < 0x600:
                assert other.codec.decode(Frame(message.arbitration_id, bytes(message.data)))


def test_stop_request_on_the_bus_is_latched(program: Path) -> None:
    with process(program) as (_, channel), adapter(channel) as bus, bus.client(1) as stage:
        assert start(stage, node_bench.CLEAR, b"\0") == node_bench.DONE
        bus.send(pack_frame(bus.codec, StopRequest(active=True, source=Source.OPERATOR), counter=0))
        for option in (b"\0", b"\1"):
            with pytest.raises(udsoncan.exceptions.NegativeResponseException, match="ConditionsNotCorrect"):
                start(stage, node_bench.CLEAR, option)
        bus.send(pack_frame(bus.codec, StopRequest(active=False, source=Source.OPERATOR), counter=1))
        assert start(stage, node_bench.CLEAR, b"\1") == node_bench.DONE


def test_journal_outlives_a_killed_process(program: Path, tmp_path: Path) -> None:
    arguments = ("pass_ms=20000", "--folder", str(tmp_path))
    with process(program, *arguments) as (running, channel), adapter(channel) as bus, bus.client(0) as head:
        assert start(head, node_bench.CLEAR, b"\0") == node_bench.DONE
        send_pattern(head, node_bench.pattern_blob(FULL), 1)
        head.conn.send(pack(">BBHIHBBB", 0x31, 1, node_bench.PASS, 7, 1, 0, 1, 0))
        assert head.conn.wait_frame(timeout=10) == b"\x7f\x31\x78"
        running.kill()
        running.wait()
    with process(program, *arguments) as (_, channel), adapter(channel) as bus, bus.client(0) as head:
        state = head.read_data_by_identifier(0x0100).service_data.values[0x0100]
        assert (state[11], state[12]) == (0, 1), "pass 0 is not done, and unknown"
        with pytest.raises(udsoncan.exceptions.NegativeResponseException, match="ConditionsNotCorrect"):
            start(head, node_bench.CLEAR, b"\0")
        assert start(head, node_bench.CLEAR, b"\1") == node_bench.DONE


def test_terminal_is_a_channel_too(program: Path) -> None:
    with process(program, "--pty") as (_, channel), adapter(channel) as bus, bus.client(3) as profiler:
        assert channel.startswith("/dev/")
        assert start(profiler, node_bench.CLEAR, b"\0", layer=0) == node_bench.DONE
        assert start(profiler, node_bench.SCAN, layer=0) == node_bench.DONE
        assert len(read_map(profiler, 0)) == 12 + 2 * 81 + 11


@pytest.mark.parametrize(
    ("argument", "word"),
    [("nx=0", "nx=0"), ("colour=1", "colour=1"), ("--port", "--port"), ("resolution=1.5e-10", "nanometres")],
)
def test_wrong_argument_is_said_and_nothing_runs(program: Path, argument: str, word: str) -> None:
    ended = subprocess.run([program, argument], capture_output=True, text=True, check=False)
    assert ended.returncode in (1, 2)
    assert word in ended.stderr


def test_process_ends_with_its_parent(program: Path) -> None:
    running = subprocess.Popen([program, "--until-stdin-closes"], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL)
    assert running.stdin
    running.stdin.close()
    assert running.wait(timeout=60) == 0
