"""Acceptance of the supervised frames on a node's bus: MasterAlive and StopRequest, whole, damaged and repeated."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from inkloop_hardware.protocol.codec import COUNTERS, Codec, Frame
from inkloop_hardware.protocol.records import MasterAlive, StopRequest, pack
from inkloop_hardware.protocol.services import Routine
from inkloop_hardware.protocol.vocabulary import Fault, Source
from support.benches.node_bench import CURE, DONE, GATE, HEAD, LAMP, MOTION, STAGE, NodeBench, Nrc

CODEC = Codec()


@pytest.fixture
def bench() -> Iterator[NodeBench]:
    with NodeBench() as made:
        made.ready()
        made.join()
        yield made


def stop_frame(active: bool, counter: int) -> Frame:
    return pack(CODEC, StopRequest(active, Source.OPERATOR), counter % COUNTERS)


def is_stopped(bench: NodeBench) -> bool:
    """Whether a person can not clear the node yet."""
    state = bench.state(CURE)
    assert (state.state, state.cause) == ("SAFE", Fault.STOP_REQUEST)
    return state.stopped


def damaged(frame: Frame) -> Iterator[Frame]:
    """The frame with each of its bits flipped, one after the other."""
    for bit in range(8 * len(frame.data)):
        data = bytearray(frame.data)
        data[bit // 8] ^= 1 << bit % 8
        yield Frame(frame.arbitration_id, bytes(data))


def test_one_whole_frame_stops_and_two_in_a_row_release(bench: NodeBench) -> None:
    bench.give(stop_frame(True, 4))
    assert is_stopped(bench)
    bench.give(stop_frame(False, 5))
    assert is_stopped(bench)
    assert bench.clear(CURE, 1) == -Nrc.CONDITIONS
    bench.give(stop_frame(False, 6))
    assert not is_stopped(bench)
    assert bench.clear(CURE, 1) == DONE


def test_damaged_frame_neither_stops_nor_releases(bench: NodeBench) -> None:
    for frame in damaged(stop_frame(True, 0)):
        bench.give(frame)
    assert bench.state(CURE).state == "IDLE"
    bench.give(stop_frame(True, 0))
    for counter in (1, 2, 3):
        for frame in damaged(stop_frame(False, counter)):
            bench.give(frame)
    assert is_stopped(bench)


@pytest.mark.parametrize("name", ["StopRequest", "MasterAlive"])
def test_frame_of_another_length_is_damaged_although_its_check_byte_is_right(bench: NodeBench, name: str) -> None:
    whole = {"StopRequest": stop_frame(True, 0), "MasterAlive": alive_frame(1, 1)}[name]
    other = whole.data + b"\0" if len(whole.data) < 8 else whole.data[:-1]
    assert whole.data[-1] == 0 or len(other) > len(whole.data), "what is missing counts as 0"
    for _ in range(2):
        bench.give(Frame(whole.arbitration_id, other))
    expected = ("IDLE", 0) if name == "StopRequest" else ("SAFE", Fault.SUPERVISION)
    assert bench.state_and_cause(CURE) == expected


def test_damaged_frame_that_passes_its_check_by_chance_releases_nothing(bench: NodeBench) -> None:
    """One of 256 does: of any two bytes of content, one check byte fits."""
    bench.give(stop_frame(True, 0))
    passed = 0
    for content in range(0, 1 << 16, 7):
        for check in range(256):
            frame = Frame(stop_frame(True, 0).arbitration_id, bytes([check]) + content.to_bytes(2, "little") + b"\1")
            if passed < 40 and CODEC.decode(frame).intact and not CODEC.decode(frame).values["Active"]:
                passed += 1
                bench.give(frame)
                bench.give(next(damaged(frame)))
        if passed == 40:
            break
    assert passed == 40
    assert is_stopped(bench)


@pytest.mark.parametrize("counters", [(1, 1, 1), (1, 9, 3), (5, 5, 12)])
def test_old_frame_that_is_repeated_releases_nothing(bench: NodeBench, counters: tuple[int, ...]) -> None:
    bench.give(stop_frame(True, 0))
    for counter in counters:
        bench.give(stop_frame(False, counter))
    assert is_stopped(bench)


def test_request_between_two_releases_keeps_the_node_stopped(bench: NodeBench) -> None:
    bench.give(stop_frame(True, 0))
    for counter in range(1, 9):
        bench.give(stop_frame(counter % 2 == 0, counter))
        assert is_stopped(bench)


def test_release_of_another_sender_counts_its_own_frames(bench: NodeBench) -> None:
    """Its counter begins anywhere; a lost frame in between is tolerated."""
    bench.give(stop_frame(True, 0))
    for counter in (7, 9):
        assert is_stopped(bench)
        bench.give(stop_frame(False, counter))
    assert not is_stopped(bench)


def alive_frame(session: int, counter: int) -> Frame:
    return pack(CODEC, MasterAlive(True, True, True, session, 7), counter % COUNTERS)


def test_frame_after_a_lost_one_drops_what_it_does_not_enable(bench: NodeBench) -> None:
    bench.master = None
    for counter in (0, 1):
        bench.give(alive_frame(1, counter))
    assert bench.raw(bench.routine(Routine.CURE, 1, option=b"\x13\x88"), CURE) == b"\x7f\x31\x78"
    bench.tick(50)
    assert bench.state(CURE).state == "CURING"
    bench.give(pack(CODEC, MasterAlive(False, True, True, 1, 7), 3))
    assert bench.state_and_cause(CURE) == ("SAFE", Fault.ENABLE_DROPPED)


@pytest.mark.parametrize("only", [LAMP, GATE, MOTION])
def test_each_enable_of_the_bus_allows_its_own(bench: NodeBench, only: int) -> None:
    bench.master = None
    record = MasterAlive(only == LAMP, only == GATE, only == MOTION, 1, 7)
    for counter in (0, 1):
        bench.give(pack(CODEC, record, counter))
    allowed = {
        LAMP: bench.raw(bench.routine(Routine.SELF_TEST, option=b"\0\x64"), CURE),
        GATE: bench.raw(bench.routine(Routine.SELF_TEST, option=b"\0\0"), HEAD),
        MOTION: bench.raw(bench.routine(Routine.HOME, attempt=2), STAGE),
    }
    assert [enable for enable, answer in allowed.items() if answer[2] == Nrc.PENDING] == [only]


def silence(bench: NodeBench) -> None:
    bench.master = None
    bench.tick(400)
    assert bench.state(CURE).state == "SAFE"


def test_supervision_is_restarted_for_a_new_session(bench: NodeBench) -> None:
    """The counter of a new master begins anywhere, and what its predecessor sent does not count against it."""
    for counter in (0, 0, 0):
        bench.give(alive_frame(1, counter))
    silence(bench)
    assert bench.clear(CURE) == -Nrc.CONDITIONS
    bench.give(alive_frame(2, 9))
    assert bench.clear(CURE) == DONE
    assert bench.state(CURE).session == 2


def test_new_session_is_supervised_like_the_old_one(bench: NodeBench) -> None:
    silence(bench)
    bench.give(alive_frame(2, 9))
    assert bench.clear(CURE) == DONE
    for _ in range(2):
        bench.give(alive_frame(2, 9))
    assert bench.clear(CURE) == -Nrc.CONDITIONS
    assert bench.state(CURE).state == "SAFE"


def test_sender_that_changes_its_session_does_not_regain_trust(bench: NodeBench) -> None:
    """A stuck sender under a new number is another master, as long as the old one was heard."""
    silence(bench)
    for session in range(2, 40):
        bench.give(alive_frame(session, 0))
        bench.give(alive_frame(session, 0))
        bench.tick(50)
    assert bench.clear(CURE, 1) == -Nrc.CONDITIONS
    bench.give(alive_frame(2, 1))
    assert bench.state_and_cause(CURE) == ("SAFE", Fault.TWO_MASTERS)
