"""The parts of the bus process: messages over the pipes, calls that do not wait, and the disk after a killed run."""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import Any

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from inkloop_hardware.bus.adapter import data_frame, message_of
from inkloop_hardware.bus.messages import (
    FRAMES_AT_ONCE,
    HEAD,
    ROOM,
    Kind,
    Outbox,
    pack_frames,
    read_message,
    unpack_frames,
    write_message,
)
from inkloop_hardware.bus.traffic_log import SteadyClock, TrafficLog
from inkloop_hardware.errors import BusError
from inkloop_hardware.protocol.codec import EXTENDED, FD_LENGTHS, Frame

FRAMES = st.builds(Frame, st.integers(0, 0x7FF), st.binary(max_size=8))
WIDE_FRAMES = st.builds(
    lambda identifier, length: Frame(EXTENDED | identifier, bytes(range(length)), True),
    st.integers(0, (1 << 29) - 1),
    st.sampled_from(FD_LENGTHS),
)


class Trickle(io.RawIOBase):
    """A stream that takes a few bytes at a time, as a pipe that is nearly full does."""

    def __init__(self) -> None:
        self.taken = b""

    def writable(self) -> bool:
        return True

    def write(self, data: Any) -> int:
        piece = bytes(memoryview(data)[:3])
        self.taken += piece
        return len(piece)


@given(st.lists(FRAMES | WIDE_FRAMES, max_size=200), st.floats(0, 1e9))
def test_frames_cross_the_pipe_as_they_are(frames: list[Frame], now: float) -> None:
    stream = Trickle()
    write_message(stream, Kind.FRAMES, pack_frames(frames, now))
    write_message(stream, Kind.CLOSE)
    found = io.BytesIO(stream.taken)
    message = read_message(found)
    assert message is not None
    assert message[0] is Kind.FRAMES
    assert list(unpack_frames(message[1])) == [(now, frame) for frame in frames]
    assert read_message(found) == (Kind.CLOSE, b"")
    assert read_message(found) is None


def test_frames_that_leave_at_once_fit_into_a_pipe() -> None:
    """A pipe takes 4096 bytes whole or not at all."""
    widest = Frame(EXTENDED, bytes(FD_LENGTHS[-1]), True)
    assert len(pack_frames([widest] * FRAMES_AT_ONCE)) + HEAD.size <= 4096


@given(FRAMES | WIDE_FRAMES, st.booleans())
def test_frame_is_the_same_for_python_can(frame: Frame, switch: bool) -> None:
    message = message_of(frame, bit_rate_switch=switch)
    assert message.arbitration_id < (1 << (29 if message.is_extended_id else 11))
    assert message.bitrate_switch == (frame.is_fd and switch)
    assert data_frame(message) == frame


def test_message_that_is_cut_off_is_the_end() -> None:
    stream = Trickle()
    write_message(stream, Kind.MESSAGE, b"some words")
    for length in range(len(stream.taken)):
        assert read_message(io.BytesIO(stream.taken[:length])) is None


@pytest.mark.system
def test_slow_reader_is_not_waited_for_and_dropped_messages_are_counted() -> None:
    reading, writing = os.pipe()
    outbox = Outbox(io.FileIO(writing, "w"))
    content = pack_frames([Frame(1, b"12345678")] * 10_000)
    count = 3 * ROOM // len(content)
    for _ in range(count):
        outbox.put(Kind.FRAMES, content, may_drop=True)
    assert 0 < outbox.dropped < 10_000 * count
    outbox.put(Kind.FAILED, b"words are never dropped")
    arrived, failure = 0, b""
    with io.BufferedReader(io.FileIO(reading, "r")) as stream:
        while not failure:
            message = read_message(stream)
            assert message is not None
            arrived += sum(1 for _ in unpack_frames(message[1])) if message[0] is Kind.FRAMES else 0
            failure = message[1] if message[0] is Kind.FAILED else b""
    outbox.close()
    assert arrived + outbox.dropped == 10_000 * count


def test_reader_that_is_gone_ends_the_outbox_without_an_error() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    outbox = Outbox(io.FileIO(writing, "w"))
    for _ in range(10):
        outbox.put(Kind.MESSAGE, b"without a reader")
    outbox.close()
    assert not outbox._thread.is_alive()


def message(number: int) -> can.Message:
    return can.Message(1.7e9 + number / 100, 0x100 + number % 16, False, data=bytes([number % 256] * 8))


def logged(path: Path) -> list[can.Message]:
    options = {} if path.suffix.lower() == ".blf" else {"relative_timestamp": False}
    with can.LogReader(path, **options) as reader:
        return list(reader)


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".BLF"])
@pytest.mark.parametrize("is_closed", [True, False])
def test_log_is_readable_up_to_its_last_flush(tmp_path: Path, suffix: str, is_closed: bool) -> None:
    """Also of a process that was killed: the file is copied as it is on the disk."""
    log = TrafficLog(tmp_path / f"traffic{suffix}", float)
    for number in range(250):
        log.take(message(number))
        if number % 100 == 99:
            log.flush(float(number))
    if is_closed:
        log.close()
    copy = tmp_path / f"copy{suffix}"
    copy.write_bytes((tmp_path / f"traffic{suffix}").read_bytes())
    found = logged(copy)
    if not is_closed:
        log.close()
    assert len(found) >= (250 if is_closed else 100)  # those of the last cycle wait for earlier ones
    for number, one in enumerate(found):
        expected = message(number)
        assert (one.arbitration_id, bytes(one.data)) == (expected.arbitration_id, bytes(expected.data))
        assert one.timestamp == pytest.approx(expected.timestamp, abs=1e-2)


@pytest.mark.parametrize("suffix", [".blf", ".asc"])
def test_times_of_a_log_never_go_back(tmp_path: Path, suffix: str) -> None:
    """Frames of one cycle are put in order; one that comes too late gets the time of the frame before it."""
    path = tmp_path / f"traffic{suffix}"
    log = TrafficLog(path, float)
    for cycle, numbers in enumerate([(5, 3, 8), (6, 12, 11), (2, 20, 19)], 1):
        for number in numbers:
            log.take(message(number))
        log.flush(2.0 * cycle)
    log.close()
    found = logged(path)
    assert [one.arbitration_id - 0x100 for one in found] == [3, 5, 6, 8, 2, 11, 12, 3, 4]
    times = [one.timestamp - found[0].timestamp for one in found]
    assert [round(at, 3) for at in times] == [0.0, 0.02, 0.03, 0.05, 0.05, 0.08, 0.09, 0.16, 0.17]
    assert times == sorted(times)
    assert abs(found[0].timestamp - message(3).timestamp) < 1


@pytest.mark.parametrize("suffix", [".blf", ".asc"])
def test_log_holds_frames_of_can_fd_with_long_ids(tmp_path: Path, suffix: str) -> None:
    frames = [Frame(EXTENDED | 0x18DA10F1, bytes(range(64)), True), Frame(0x123, b"12345678", True), Frame(0x7FF, b"1")]
    log = TrafficLog(tmp_path / f"traffic{suffix}", float)
    for number, frame in enumerate(frames):
        sent = message_of(frame, bit_rate_switch=True)
        sent.timestamp = 1.7e9 + number
        log.take(sent)
    log.close()
    found = logged(tmp_path / f"traffic{suffix}")
    assert [data_frame(one) for one in found] == frames
    assert [one.bitrate_switch for one in found] == [True, True, False]


def test_log_of_before_is_kept_and_no_link_followed(tmp_path: Path) -> None:
    (tmp_path / "traffic-2.asc").symlink_to(tmp_path / "nowhere")
    for count in (1, 2, 3):
        log = TrafficLog(tmp_path / "traffic.asc", float)
        for number in range(count):
            log.take(message(number))
        log.close()
    counts = {path.name: len(logged(path)) for path in tmp_path.iterdir() if not path.is_symlink()}
    assert counts == {"traffic.asc": 1, "traffic-3.asc": 2, "traffic-4.asc": 3}


def test_log_that_cannot_be_written_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BusError, match=r"traffic log .*file.a\.blf cannot be written"):
        TrafficLog(tmp_path / "file" / "a.blf")
    with pytest.raises(BusError, match=r"its suffix is '\.csv', expected \.blf or \.asc"):
        TrafficLog(tmp_path / "a.csv")


def test_times_of_a_log_go_on_when_the_clock_of_the_machine_is_set(tmp_path: Path) -> None:
    """Back by an hour between two frames, and forward by two between the next; each came 1 ms before it is logged."""
    now, wall = 50.0, 1.8e9

    class Clock:
        steady, set_by = now, 0.0

        def wall(self) -> float:
            return wall + self.steady - now + self.set_by

    clock = Clock()
    log = TrafficLog(tmp_path / "traffic.blf", SteadyClock(clock.wall, lambda: clock.steady).of)
    for set_by in (0.0, -3600.0, 3600.0):
        clock.steady, clock.set_by = clock.steady + 0.25, set_by
        log.take(can.Message(timestamp=clock.wall() - 1e-3, arbitration_id=1))
    log.close()
    times = [message.timestamp - wall for message in can.LogReader(tmp_path / "traffic.blf")]
    assert times == pytest.approx([0.249, 0.499, 0.749], rel=0.0, abs=1e-6)
