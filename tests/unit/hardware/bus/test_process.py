"""The parts of the bus process: messages over the pipes, calls that do not wait, and the disk after a killed run."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from pathlib import Path
from threading import Event
from typing import Any
from unittest.mock import Mock

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from inkloop_hardware.bus.adapter import data_frame, message_of
from inkloop_hardware.bus.heartbeat import Enables
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
from inkloop_hardware.bus.process import BusProcess
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.bus.traffic_log import SteadyClock, TrafficLog
from inkloop_hardware.errors import BusError, BusOff
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
    assert not message.is_rx, "a log of it would take it for one that was received"
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
def test_frames_are_written_once_a_second_and_those_of_the_last_one_wait(tmp_path: Path, suffix: str) -> None:
    path, copy, counts = tmp_path / f"traffic{suffix}", tmp_path / f"copy{suffix}", []
    log = TrafficLog(path, float)
    for number, now in enumerate((5.0, 5.9, 6.0, 6.9, 7.0)):
        log.take(message(number))
        log.flush(now)
        copy.write_bytes(path.read_bytes())
        counts.append(len(logged(copy)))
    log.close()
    assert counts == [0, 0, 1, 1, 3]


def test_newest_frame_is_written_after_a_cycle_though_an_older_one_came_after_it(tmp_path: Path) -> None:
    path, copy = tmp_path / "traffic.asc", tmp_path / "copy.asc"
    log = TrafficLog(path, float)
    for number in (5, 3):
        log.take(message(number))
    for now in (2.0, 3.0):
        log.flush(now)
    copy.write_bytes(path.read_bytes())
    log.close()
    assert [one.arbitration_id - 0x100 for one in logged(copy)] == [3, 5]


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


@pytest.mark.parametrize(
    ("came", "logged_at"),
    [(999.5, 999.5), (998.9, 999.0), (0.0, 999.0), (1000.02, 1000.02), (1000.06, 1000.05), (2000.0, 1000.05)],
    ids=["half a second ago", "long ago", "without a time", "a moment ahead", "far ahead", "very far ahead"],
)
def test_time_of_a_frame_is_at_most_a_cycle_old_and_not_ahead(came: float, logged_at: float) -> None:
    assert SteadyClock(lambda: 1000.0, lambda: 50.0).of(came) == pytest.approx(logged_at, rel=1e-12, abs=0.0)


@pytest.mark.parametrize(("moved", "follows"), [(0.04, True), (-0.04, True), (0.06, False), (-0.06, False)])
def test_clock_that_is_kept_in_step_is_followed_and_one_that_is_set_is_not(moved: float, follows: bool) -> None:
    wall, steady = iter([1000.0, 1001.0 + moved]), iter([50.0, 51.0])
    clock = SteadyClock(lambda: next(wall), lambda: next(steady))
    expected = 1000.9 + moved if follows else 1000.9
    assert clock.of(1000.9 + moved) == pytest.approx(expected, rel=1e-12, abs=0.0)


class Told:
    """Stands for an outbox; `said` has what was put into it."""

    dropped = 0

    def __init__(self) -> None:
        self.said: list[tuple[Kind, bytes]] = []

    def put(self, kind: Kind, content: bytes, *, may_drop: bool = False) -> None:
        self.said.append((kind, content))


@pytest.fixture
def process() -> Iterator[BusProcess]:
    """A bus process without its threads."""
    made = BusProcess(BusSettings("virtual", "parts"), 1, 7, Told())  # type: ignore[arg-type]
    yield made
    made.adapter.close()


def said(process: BusProcess) -> list[tuple[Kind, bytes]]:
    found: Any = process.answers
    return list(found.said)


def test_problem_is_reported_when_it_begins_and_whenever_its_count_has_doubled(process: BusProcess) -> None:
    """An adapter that is opened again counts from the beginning."""
    for count in (0, 1, 1, 2, 3, 4, 7, 20, 39):
        process.adapter.complaints = Mock(return_value={"malformed lines": count})
        process._complain()
    assert said(process) == [(Kind.MESSAGE, b"virtual on parts: %d malformed lines so far" % n) for n in (1, 2, 4, 20)]
    process.adapter.close()
    assert process._opened_again()
    process.adapter.complaints = Mock(return_value={"malformed lines": 1})
    process.answers.dropped = 5
    process._complain()
    assert [words for _, words in said(process)][-2:] == [
        b"virtual on parts: 1 malformed lines so far",
        b"virtual on parts: 5 frames that the master did not read so far",
    ]


@pytest.mark.parametrize(("since", "is_lit"), [(0.5, True), (1.5, True), (2.0, True), (2.5, False)])
def test_bus_that_went_while_the_lamp_was_enabled_is_left_to_a_person(
    since: float, is_lit: bool, process: BusProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Enabled from 1 s to 2 s."""
    for now, enables in ((1.0, Enables.LAMP), (2.0, Enables.NONE), (3.0, Enables.GATE)):
        process.heartbeat.keep_alive(now, enables)
        process._note_lamp(now)
    monkeypatch.setattr(process, "_waited", lambda pause: False)
    monkeypatch.setattr(process, "_opened_again", lambda: True)
    if is_lit:
        with pytest.raises(BusError, match=r"off\. The lamp was enabled"):
            process._reopen(BusOff("off.", since))
    else:
        process._reopen(BusOff("off.", since))
        assert [kind for kind, _ in said(process)] == [Kind.DISCONNECTED, Kind.MESSAGE, Kind.DISCONNECTED]
        assert [words for _, words in said(process)][::2] == [b"off. It is being opened again", b""]
    assert (process.heartbeat.beating, process.heartbeat.lapsed) == (False, True)


def test_unplugged_adapter_is_opened_again_also_with_the_lamp_enabled(
    process: BusProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is enabled then, and a node without a master puts its lamp out."""
    process.heartbeat.keep_alive(1.0, Enables.LAMP)
    process._note_lamp(1.0)
    monkeypatch.setattr(process, "_waited", lambda pause: False)
    monkeypatch.setattr(process, "_opened_again", lambda: True)
    process._reopen(BusError("unplugged."))
    assert said(process)[-1] == (Kind.DISCONNECTED, b"")


def test_first_failure_is_the_one_that_is_told(process: BusProcess) -> None:
    for error in (BusError("unplugged"), BusError("closed"), ValueError("no number")):
        process._guarded(Mock(side_effect=error))
        assert process.failure == "unplugged"
        assert process.over.is_set()


def test_adapter_that_is_gone_gets_no_frame_and_begins_no_heartbeat(process: BusProcess) -> None:
    commands = io.BytesIO()
    write_message(commands, Kind.ALIVE, b"\0")  # type: ignore[arg-type]
    write_message(commands, Kind.FRAMES, pack_frames([Frame(0x640, b"1")]))  # type: ignore[arg-type]

    def sent(*, is_open: bool, trouble: BusError | None) -> list[int]:
        process._open, process._trouble, process.heartbeat.beating = is_open, trouble, False
        process.adapter.send = Mock()
        commands.seek(0)
        process._take_commands(commands)
        return [call.args[0].arbitration_id for call in process.adapter.send.mock_calls]

    assert sent(is_open=False, trouble=None) == []
    assert not process.heartbeat.beating
    assert sent(is_open=True, trouble=BusError("it takes no frame")) == []
    assert sent(is_open=True, trouble=None) == [0x20, 0x640]


class Stuck(io.RawIOBase):
    """A reader that takes nothing until it may."""

    def __init__(self) -> None:
        self.waits, self.goes_on = Event(), Event()

    def writable(self) -> bool:
        return True

    def write(self, data: Any) -> int:
        self.waits.set()
        self.goes_on.wait()
        return len(data)


def test_only_frames_count_among_the_messages_that_find_no_room() -> None:
    stream = Stuck()
    outbox = Outbox(stream)
    outbox.put(Kind.MESSAGE, b"the first")
    stream.waits.wait()
    outbox.put(Kind.FRAMES, bytes(ROOM), may_drop=True)
    outbox.put(Kind.CLOCK, bytes(8), may_drop=True)
    assert outbox.dropped == 0
    outbox.put(Kind.FRAMES, pack_frames([Frame(1, b"1"), Frame(2, b"")]), may_drop=True)
    assert outbox.dropped == 2
    stream.goes_on.set()
    outbox.close()
