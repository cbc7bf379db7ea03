"""An adapter that speaks slcan is read in bulk, and nothing that it sends ends the reading."""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import can
import pytest
from can.interfaces.slcan import slcanBus
from hypothesis import given, settings
from hypothesis import strategies as st

from inkloop_hardware.bus.adapter import Adapter
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.bus.slcan_bus import LINE_MAX, BulkSlcanBus, frame_of
from inkloop_hardware.errors import BusError
from inkloop_hardware.protocol.codec import Frame
from support.benches.wire_library import SlcanEnd, SlcanFrame

FRAMES = st.builds(
    lambda extended, identifier, remote, data: SlcanFrame(
        identifier % (1 << (29 if extended else 11)), extended, remote, len(data), b"" if remote else data
    ),
    st.booleans(),
    st.integers(0, (1 << 29) - 1),
    st.booleans(),
    st.binary(max_size=8),
)
PATIENCE = 600.0
"""Ends a test that hangs; every wait is for an event."""


class Line:
    """The adapter's end of a connection: what the bus writes can be read, and text can be sent to it."""

    def __init__(self, **options: Any) -> None:
        listener = socket.create_server(("127.0.0.1", 0))
        self.channel = f"socket://127.0.0.1:{listener.getsockname()[1]}"
        found: list[socket.socket] = []
        waiting = threading.Thread(target=lambda: found.append(listener.accept()[0]))
        waiting.start()
        self.bus = BulkSlcanBus(self.channel, bitrate=500_000, **options)
        waiting.join()
        self.socket = found[0]
        listener.close()

    def heard(self, text: bytes) -> list[can.Message]:
        """Frames of a text that ends with a frame of id 0x7FF."""
        self.socket.sendall(text + b"t7FF0\r")
        frames: list[can.Message] = []
        while (message := self.bus.recv(PATIENCE)) is not None and message.arbitration_id != 0x7FF:
            frames.append(message)
        assert message is not None
        return frames


@pytest.fixture(scope="module")
def line() -> Iterator[Line]:
    made = Line()
    yield made
    made.bus.shutdown()
    made.socket.close()


@pytest.mark.compiled
@given(FRAMES, st.sampled_from([b"", b"12FE"]))
def test_frame_of_the_firmware_is_read_back_unchanged(frame: SlcanFrame, time_stamp: bytes) -> None:
    found = frame_of(SlcanEnd().write(frame).rstrip(b"\r") + time_stamp, 5.0)
    assert (found.arbitration_id, found.is_extended_id, found.is_remote_frame) == (
        frame.arbitration_id,
        frame.extended,
        frame.remote,
    )
    assert (found.dlc, bytes(found.data), found.timestamp) == (frame.length, frame.data, 5.0)


@pytest.mark.compiled
@given(st.lists(FRAMES, max_size=30), st.integers(1, 100))
def test_frames_come_whole_and_in_order_however_they_are_cut(frames: list[SlcanFrame], piece: int) -> None:
    bus = BulkSlcanBus.__new__(BulkSlcanBus)
    text = b"".join(SlcanEnd().write(frame) for frame in frames)
    bus.begin_reading()
    for at in range(0, len(text), piece):
        bus.take(text[at : at + piece])
    assert [message.arbitration_id for message in bus.waiting] == [frame.arbitration_id for frame in frames]
    assert (bus.malformed, bus.refused) == (0, 0)


@settings(max_examples=300)
@given(st.binary(max_size=200))
def test_no_text_ends_the_reading(text: bytes) -> None:
    bus = BulkSlcanBus.__new__(BulkSlcanBus)
    bus.begin_reading()
    bus.take(text + b"\r")
    before = len(bus.waiting)
    bus.take(b"t1232AABB\r")
    assert bus.waiting[-1].arbitration_id == 0x123
    assert len(bus.waiting) == before + 1


@pytest.mark.parametrize("length", [0, 8, 12, 64])
@pytest.mark.parametrize("switch", [False, True])
@pytest.mark.parametrize("extended", [False, True])
def test_line_of_a_can_fd_frame_is_that_of_python_can(length: int, switch: bool, extended: bool) -> None:
    """The class of python-can that this one extends reads what it writes, and it reads that itself."""
    own = Line(fd=True, data_bitrate=2_000_000)
    sent = can.Message(
        arbitration_id=0x123, is_extended_id=extended, is_fd=True, bitrate_switch=switch, data=bytes(range(length))
    )
    own.bus.send(sent)
    written = b""
    while b"O\r" not in written or not written.endswith(bytes(sent.data[-1:].hex().upper(), "ascii") + b"\r"):
        written += own.socket.recv(1000)
    opening, line = written.rsplit(b"\r", 2)[0], written.rsplit(b"\r", 2)[1] + b"\r"
    assert b"S6\rY2\r" in opening + b"\r"
    stock = slcanBus.__new__(slcanBus)
    stock._queue = SimpleQueue()
    stock._queue.put(line.decode())
    for found in (stock._recv_internal(0.0)[0], own.heard(line)[0]):
        assert found is not None
        assert found.equals(sent, timestamp_delta=None, check_channel=False, check_direction=False)
    own.bus.shutdown()
    own.socket.close()


BAD = [
    *(b"t12", b"t1239AABB", b"t1232AAB", b"tXYZ0", b"T123", b"d1230", b"hello", b"t12 0"),
    b"t1239" + b"AA" * 9,  # more bytes than a frame has
    b"t1231AA12",  # half a time stamp
    *(b"t8000", b"T200000000"),  # ids of 12 and of 30 bits
]


@pytest.mark.parametrize("bad", BAD)
def test_malformed_line_is_counted_and_the_next_frame_read(line: Line, bad: bytes) -> None:
    before = line.bus.malformed
    assert [m.arbitration_id for m in line.heard(b"t0010\r" + bad + b"\rt0020\r")] == [1, 2]
    assert line.bus.malformed == before + 1


def test_longest_frame_with_its_time_stamp_is_read() -> None:
    data = bytes(range(64))
    text = f"B1ABCDEF0F{data.hex().upper()}12AB\r".encode()
    bus = BulkSlcanBus.__new__(BulkSlcanBus)
    bus._is_shutdown = True
    bus.begin_reading(fd=True)
    bus.take(text + text)
    assert [(one.arbitration_id, bytes(one.data)) for one in bus.waiting] == 2 * [(0x1ABCDEF0, data)]
    assert bus.malformed == 0


def test_rest_of_a_line_that_is_too_long_is_no_frame(line: Line) -> None:
    before = line.bus.malformed
    line.bus.take(b"x" * (LINE_MAX + 1))
    line.bus.take(b"x" * (LINE_MAX + 1))
    assert [m.arbitration_id for m in line.heard(b"t0010\rt0020\r")] == [2]
    assert line.bus.malformed == before + 1


def test_refusals_of_the_adapter_are_counted_and_its_answers_are_not(line: Line) -> None:
    line.heard(b"")
    malformed, refused = line.bus.malformed, line.bus.refused
    line.heard(b"\a\az\rZ\r\rV1013\r\a")
    assert (line.bus.malformed, line.bus.refused) == (malformed, refused + 3)
    line.heard(b"hello\r")
    found = Adapter(BusSettings("slcan", "/dev/ttyACM0"), line.bus).complaints()
    assert found["malformed lines of the adapter"] == malformed + 1
    assert found["commands that the adapter refused"] == refused + 3


def test_adapter_that_refuses_for_a_while_and_confirms_nothing_is_off_the_bus(
    line: Line, monkeypatch: pytest.MonkeyPatch
) -> None:
    bus, clock = line.bus, Clock()
    monkeypatch.setattr("inkloop_hardware.bus.slcan_bus.time.monotonic", clock)

    def off_since(text: bytes, now: float) -> float | None:
        clock.now = now
        bus.take(text)
        return bus.bus_off_since

    bus.begin_reading()
    assert off_since(b"\a\a", 1.0) is off_since(b"", 5.0) is None, "refused commands, before any frame"
    assert off_since(b"t7FF0\r", 9.0) is off_since(b"\a", 10.0) is off_since(b"", 19.0) is None, "a single refusal"
    for confirmed in (b"z\r", b"Z\r", b"t7FF0\r"):
        assert off_since(confirmed + b"\a", 20.0) is off_since(confirmed + b"\a", 20.1) is None
        assert [off_since(b"\a", 30.0), off_since(b"\a", 30.125), off_since(b"", 30.25)] == [None, None, 30.0]
        assert off_since(confirmed, 31.0) is None
    bus.begin_reading()


@pytest.mark.compiled
def test_adapter_gets_the_lines_that_the_firmware_understands(line: Line) -> None:
    written = bytearray()
    end = SlcanEnd(opened=False)
    line.bus.send(can.Message(arbitration_id=0x641, data=b"\x10\xff\x00", is_extended_id=False))
    line.bus.send(can.Message(arbitration_id=0x12345678, data=b"", is_extended_id=True))
    while written.count(b"T") < 1 or not written.endswith(b"\r"):
        written += line.socket.recv(1000)
    frames, _answers = end.take(bytes(written))
    assert [(frame.arbitration_id, frame.data) for frame in frames] == [(0x641, b"\x10\xff\x00"), (0x12345678, b"")]


def test_closed_connection_is_reported() -> None:
    own = Line()
    adapter = Adapter(BusSettings("slcan", own.channel), own.bus)
    own.socket.close()
    with pytest.raises(BusError, match=r"slcan on socket://127.*cannot be read any more.*unplugged"):
        adapter.receive(PATIENCE)
    adapter.close()


@pytest.mark.skipif(os.name != "posix", reason="needs a pseudo-terminal")
def test_terminal_is_read_and_written() -> None:
    ours, theirs = os.openpty()
    os.set_blocking(ours, True)
    adapter = Adapter(BusSettings("slcan", os.ttyname(theirs), 500_000, {"sleep_after_open": 0.0}))
    os.write(ours, b"t1232AABB\r")
    assert [bytes(message.data) for message in adapter.receive(PATIENCE)] == [b"\xaa\xbb"]
    adapter.send(Frame(0x20, b"\x01"))
    written = b""
    while not written.endswith(b"t020101\r"):
        written += os.read(ours, 100)
    assert written.startswith(b"C\rS6\r")
    adapter.close()
    os.close(ours)
    os.close(theirs)


class Full(can.BusABC):
    """An adapter whose queue is full for the first `tries` sends."""

    def __init__(self, tries: int) -> None:
        self.tries = tries
        self.sent: list[can.Message] = []
        super().__init__("full")

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self.tries -= 1
        if self.tries >= 0:
            raise can.CanOperationError("Failed to transmit", 105)
        self.sent.append(msg)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        return None, False


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


def test_full_queue_is_waited_for_and_the_same_frame_sent() -> None:
    bus, clock = Full(7), Clock()
    adapter = Adapter(BusSettings("socketcan", "can0"), bus, monotonic=clock, sleep=clock.sleep)
    adapter.send(Frame(0x20, b"\x05"))
    assert [bytes(message.data) for message in bus.sent] == [b"\x05"]
    assert adapter.complaints()["frames sent again"] == 7
    assert clock.now == pytest.approx(sum(0.001 * 2**tried for tried in range(7)), rel=1e-9, abs=0.0)


class Flooded(Full):
    """An adapter that has as many frames."""

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        self.tries -= 1
        return (can.Message() if self.tries >= 0 else None), True


def test_flooded_bus_does_not_keep_the_reader_from_its_other_work() -> None:
    assert len(Adapter(BusSettings("socketcan", "can0"), Flooded(2000)).receive(0.0)) == 512


def test_queue_that_stays_full_is_reported_after_a_second() -> None:
    clock = Clock()
    adapter = Adapter(BusSettings("socketcan", "can0"), Full(1 << 30), monotonic=clock, sleep=clock.sleep)
    with pytest.raises(BusError, match=r"socketcan on can0 accepts no frame for 1 s.*terminated"):
        adapter.send(Frame(0x20, b"\x05"))
    assert clock.now <= 1.0
    adapter.is_gone, clock.now = True, 5.0
    with pytest.raises(BusError, match="accepts no frame"):
        adapter.send(Frame(0x20, b"\x05"))
    assert clock.now == 5.0, "one that is gone is not waited for"


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (BusSettings("slcan", "socket://127.0.0.1:1", 500_000), r"slcan on socket://127\.0\.0\.1:1 at 500 .*inkloop b"),
        (BusSettings("slcan", "/dev/nothing-here", 500_000), r"/dev/nothing-here.*plugged in"),
        (BusSettings("no-such-interface", "x"), r"no-such-interface on x cannot be opened"),
        (BusSettings("slcan"), r"needs a channel"),
    ],
)
def test_adapter_that_cannot_be_opened_is_named_with_what_to_do(given: BusSettings, message: str) -> None:
    with pytest.raises(BusError, match=message):
        Adapter(given)


def test_patience_of_a_bus_without_a_scenario() -> None:
    """Settings of a doctor without a scenario; a node is silent after three cycles of its status."""
    own = BusSettings()
    assert (own.loop_timeout_s, own.grace_s, own.reopen_s, own.answer_s, own.silence_s) == (120.0, 0.5, 10.0, 1.0, 0.3)


def test_settings_survive_the_way_to_another_process() -> None:
    some = BusSettings("pcan", "PCAN_USBBUS1", 1_000_000, {"receive_own_messages": False}, Path("a/b.asc"), 60.0, 0.4)
    for sent in (some, BusSettings()):
        assert BusSettings.from_json(sent.to_json()) == sent
