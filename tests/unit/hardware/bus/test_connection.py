"""Frames of the bus process are sorted; once it has ended, or is silent, every call raises its message."""

from __future__ import annotations

import io
import os
import subprocess
from collections.abc import Iterator
from struct import pack
from types import SimpleNamespace
from typing import Any

import pytest

from inkloop_hardware.bus import connection
from inkloop_hardware.bus.connection import END_LIMIT, OTHERS_MAX, SILENCE_LIMIT, BusConnection
from inkloop_hardware.bus.messages import (
    FRAMES_AT_ONCE,
    Kind,
    pack_frames,
    read_message,
    unpack_frames,
    write_message,
)
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.errors import BusError
from inkloop_hardware.protocol.codec import Frame

ANSWERS, KEPT = (0x641, 0x643), {0x101}
PATIENCE_S = 600.0


class Process:
    """A bus process without a bus: the test says what it sends. `log` has how it was ended."""

    def __init__(self) -> None:
        commands, answers = os.pipe(), os.pipe()
        self.stdin, self.stdout = io.FileIO(commands[1], "w"), io.FileIO(answers[0], "r")
        self.taken, self.answers = io.BufferedReader(io.FileIO(commands[0], "r")), io.FileIO(answers[1], "w")
        self.pid, self.hangs = 77, False
        self.log: list[Any] = []

    def sends(self, kind: Kind, content: bytes = b"") -> None:
        write_message(self.answers, kind, content)

    def ends(self) -> None:
        self.answers.close()

    def wait(self, limit_s: float | None = None) -> None:
        self.log.append(limit_s)
        if self.hangs and limit_s is not None:
            raise subprocess.TimeoutExpired("bus", limit_s)
        self.answers.close()

    def kill(self) -> None:
        self.log.append("killed")


@pytest.fixture
def process(monkeypatch: pytest.MonkeyPatch) -> Iterator[Process]:
    made = Process()
    started = SimpleNamespace(**{**vars(subprocess), "Popen": lambda *_, **__: made})
    monkeypatch.setattr(connection, "subprocess", started)
    yield made
    for stream in (made.taken, made.answers):
        stream.close()


@pytest.fixture
def bus(process: Process) -> Iterator[BusConnection]:
    process.sends(Kind.OPENED, b"nice -10")
    made = BusConnection(BusSettings("virtual", "test"), 5, 7, ANSWERS, KEPT)
    assert (made.priority, made.process_id) == ("nice -10", 77)
    yield made
    made.close()


def test_frames_go_to_whom_they_concern_and_messages_to_the_log(bus: BusConnection, process: Process) -> None:
    frames = [Frame(0x641, b"1"), Frame(0x101, b"2"), Frame(0x700, b"3"), Frame(0x643, b"4"), Frame(0x641, b"5")]
    process.sends(Kind.FRAMES, pack_frames(frames, 2.5))
    process.sends(Kind.MESSAGE, b"words")
    process.sends(Kind.DISCONNECTED, b"unplugged")
    process.sends(Kind.CLOCK, pack("<d", 2.5))
    process.sends(Kind.FRAMES, pack_frames([Frame(0x643, b"6")], 3.0))
    assert [bus.receive(0x643, PATIENCE_S) for _ in range(2)] == [b"4", b"6"]
    assert [bus.receive(0x641, 0.0) for _ in range(3)] == [b"1", b"5", None]
    assert list(bus.others) == [(2.5, Frame(0x101, b"2"))]
    assert (list(bus.messages), bus.disconnected, bus.clock) == (["words"], "unplugged", 2.5)


@pytest.mark.parametrize("kept", [KEPT, None], ids=["some", "all"])
def test_frames_that_wait_give_way_to_newer_ones(
    process: Process, kept: set[int] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connection, "OTHERS_MAX", 2)
    process.sends(Kind.OPENED)
    bus = BusConnection(BusSettings("virtual", "test"), 5, 7, ANSWERS, kept)
    process.sends(Kind.FRAMES, pack_frames([Frame(0x101, b"%d" % number) for number in range(5)], 1.0))
    process.sends(Kind.FRAMES, pack_frames([Frame(0x641, b"last")], 2.0))
    assert bus.receive(0x641, PATIENCE_S) == b"last"
    assert [frame.data for _, frame in bus.others] == [b"3", b"4"]
    bus.close()


def test_no_frame_of_many_is_left_out_and_a_message_of_them_fits_into_a_pipe(process: Process) -> None:
    process.sends(Kind.OPENED)
    bus = BusConnection(BusSettings("virtual", "test"), 5, 7, ANSWERS)
    frames = [Frame(0x640, bytes([number])) for number in range(2 * FRAMES_AT_ONCE + 1)]
    bus.send(frames)
    bus.close()
    sent: list[list[Frame]] = []
    while (message := read_message(process.taken)) is not None:
        if message[0] is Kind.FRAMES:
            sent.append([frame for _, frame in unpack_frames(message[1])])
    assert [frame for some in sent for frame in some] == frames
    assert [len(some) for some in sent] == [FRAMES_AT_ONCE, FRAMES_AT_ONCE, 1]


def test_frames_of_all_nodes_wait_while_a_plan_is_computed() -> None:
    """Four nodes have a status each 100 ms."""
    assert 4 * 10 * BusSettings().loop_timeout_s < OTHERS_MAX


def test_every_call_after_the_end_raises_the_last_message(bus: BusConnection, process: Process) -> None:
    process.sends(Kind.FAILED, b"the adapter is on fire")
    process.ends()
    for wait_s in (PATIENCE_S, 0.0):
        for identifier in ANSWERS:
            with pytest.raises(BusError, match="on fire"):
                bus.receive(identifier, wait_s)
    for call in (bus.check, lambda: bus.send([Frame(1, b"")]), lambda: bus.send_job(9)):
        with pytest.raises(BusError, match="on fire"):
            call()


def test_process_that_says_nothing_any_more_is_an_error(
    bus: BusConnection, process: Process, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Until it says something again."""
    begun = connection.time.monotonic()  # type: ignore[attr-defined]
    for passed, is_silent in ((SILENCE_LIMIT - 1.0, False), (SILENCE_LIMIT + 1.0, True)):
        monkeypatch.setattr(connection.time, "monotonic", lambda now=begun + passed: now)  # type: ignore[attr-defined]
        if is_silent:
            with pytest.raises(BusError, match=r"virtual on test has sent nothing for 2\d s"):
                bus.check()
        else:
            bus.check()
    process.sends(Kind.FRAMES, pack_frames([Frame(0x641, b"1")]))
    assert bus.receive(0x641, PATIENCE_S) == b"1"
    bus.check()


@pytest.mark.parametrize("hangs", [False, True])
def test_process_is_asked_to_end_and_killed_if_it_does_not(process: Process, hangs: bool) -> None:
    process.sends(Kind.OPENED)
    bus, process.hangs = BusConnection(BusSettings("virtual", "test"), 5, 7, ANSWERS), hangs
    bus.send_job(9)
    bus.close()
    kinds = []
    while (message := read_message(process.taken)) is not None:
        kinds.append(message[0])
    assert kinds == [Kind.SETTINGS, Kind.JOB, Kind.CLOSE]
    assert process.log == ([END_LIMIT, "killed", None] if hangs else [END_LIMIT])


def test_process_that_does_not_open_is_ended(process: Process) -> None:
    process.sends(Kind.FAILED, b"no such interface")
    process.ends()
    with pytest.raises(BusError, match="no such interface"):
        BusConnection(BusSettings("virtual", "test"), 5, 7, ANSWERS)
    assert process.log == [END_LIMIT]
