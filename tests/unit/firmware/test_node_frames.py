"""The frames of a node on its bus: what it sends and when, its ISO-TP, and which supervised frames it accepts."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from inkloop_hardware.protocol.codec import COUNTERS, Codec, Frame
from inkloop_hardware.protocol.records import (
    Fault,
    MasterAlive,
    Node,
    NodeFault,
    NodeStatus,
    Record,
    Source,
    State,
    StopRequest,
    pack,
    unpack,
)
from inkloop_hardware.protocol.services import Routine
from support.benches.node_bench import (
    CURE,
    DONE,
    GATE,
    HEAD,
    LAMP,
    MOTION,
    PROFILER,
    STAGE,
    NodeBench,
    Nrc,
    pattern_blob,
)

CODEC = Codec()
NUMBER = {Node.HEAD: HEAD, Node.STAGE: STAGE, Node.CURE: CURE, Node.PROFILER: PROFILER}
REQUEST_ID = 0x640
"""Of the head."""


@pytest.fixture
def bench() -> Iterator[NodeBench]:
    with NodeBench(pass_ms=400) as made:
        made.ready()
        made.join()
        yield made


def record(frame: Frame) -> Record:
    return unpack(CODEC, CODEC.decode(frame))


def next_of(bench: NodeBench, node: int, kind: type[Record]) -> Record:
    """The next record of a kind; time passes until it comes."""
    for _ in range(400):
        while (frame := bench.sent(node)) is not None:
            if isinstance(found := record(frame), kind):
                return found
        bench.tick()
    raise AssertionError(f"no {kind.__name__}")


def status(bench: NodeBench, node: int = HEAD) -> NodeStatus:
    while bench.sent(node):
        pass
    found = next_of(bench, node, NodeStatus)
    assert isinstance(found, NodeStatus)
    return found


def begin_pass(bench: NodeBench, number: int, layer: int = 1) -> None:
    assert bench.raw(bench.routine(Routine.PASS, layer, number, option=bytes([number]))) == b"\x7f\x31\x78"
    bench.tick(100)


def test_status_says_what_is_printed_unknown_and_open(bench: NodeBench) -> None:
    for layer in (1, 2, 3):
        bench.print_layer(np.eye(9, 8), layer)
    assert bench.download(pattern_blob(np.ones((9, 8))), 4) == 0
    for number in (0, 1):
        assert bench.jet(4, number) == DONE
    begin_pass(bench, 2, layer=4)
    seen = status(bench)
    assert (seen.node, seen.state, seen.fault) == (Node.HEAD, State.PRINTING, Fault.NONE)
    assert (seen.layer, seen.pass_mask, seen.unknown_mask) == (4, 0b0011, 0)
    assert (seen.gate_open, seen.gate_closed, seen.lamp_on, seen.ready) == (True, False, False, True)
    assert (seen.boot_count, seen.protocol_version) == (1, CODEC.protocol_version)
    for _ in range(19):
        bench.power_up()
    bench.join()
    bench.tick(100)
    seen = status(bench)
    assert (seen.state, seen.fault, seen.boot_count) == (State.SAFE, Fault.PASS_UNKNOWN, 20)
    assert (seen.layer, seen.pass_mask, seen.unknown_mask) == (4, 0b0011, 0b0100)
    assert (seen.gate_open, seen.gate_closed) == (False, True)


def test_status_of_the_lamp_node_shows_its_lamp(bench: NodeBench) -> None:
    assert not status(bench, CURE).lamp_on
    bench.raw(bench.routine(0x0204, 1, option=b"\x03\xe8"), CURE)
    seen = status(bench, CURE)
    assert (seen.node, seen.state, seen.lamp_on, seen.gate_open) == (Node.CURE, State.CURING, True, False)


@pytest.mark.parametrize("node", list(NUMBER))
def test_status_comes_every_100_ms_and_its_counter_goes_round(bench: NodeBench, node: Node) -> None:
    found = []
    for _ in range(1800):
        bench.tick(1, step=1)
        while frame := bench.sent(NUMBER[node]):
            reading = CODEC.decode(frame)
            assert reading.message == f"{node}Status"
            found.append((bench.clock, frame.data[1] & 0xF))
    times, counters = (np.array(each) for each in zip(*found, strict=True))
    assert set(np.diff(times)) == {100}
    assert counters.tolist() == [number % COUNTERS for number in range(18)]


def test_fault_is_sent_at_once_then_every_second_until_it_is_over(bench: NodeBench) -> None:
    assert bench.download(pattern_blob(np.ones((9, 8))), 1) == 0
    assert bench.jet(1) == DONE
    begin_pass(bench, 1)
    while bench.sent():
        pass
    bench.stop(True)
    began = bench.clock
    faults: list[tuple[int, NodeFault]] = []
    for now in range(3500):
        if now == 2300:
            bench.stop(False)
            assert bench.clear(option=1) == DONE
        while frame := bench.sent():
            if isinstance(found := record(frame), NodeFault):
                faults.append((bench.clock - began, found))
        bench.tick(1, step=1)
    times = [time for time, _ in faults]
    assert times[:3] == [0, 1000, 2000]
    assert len(times) == 4
    assert 2300 <= times[3] < 2310
    stopped = [(fault.node, fault.fault, fault.pass_, fault.layer) for _, fault in faults[:3]]
    assert stopped == [(Node.HEAD, Fault.STOP_REQUEST, 1, 1)] * 3
    assert {round(1e3 * fault.node_time, 6) for _, fault in faults[:3]} == {began}
    over = faults[3][1]
    assert (over.fault, over.layer) == (Fault.NONE, 1)
    assert over.node_time == pytest.approx((began + times[3]) / 1e3, rel=1e-9, abs=0.0)


@pytest.mark.parametrize("kind", [0x1000, 0x2000], ids=["extended", "remote"])
def test_extended_and_remote_frames_are_those_of_others(bench: NodeBench, kind: int) -> None:
    """Their low bits may be those of a stop request, or of a request to the node; a remote frame has no content."""
    stop = CODEC.encode("StopRequest", {"Active": 1, "Source": 0}, 3)
    bench.give(Frame(stop.arbitration_id | kind, stop.data))
    bench.give(Frame(REQUEST_ID | kind, b"\x02\x10\x83"))
    assert bench.state().state == "IDLE"
    assert bench.raw(b"\x22\xf1\x86")[3] == 1
    bench.give(stop)
    assert bench.state().state == "SAFE"


def answers(bench: NodeBench) -> list[bytes]:
    """ISO-TP answers that the node sends now."""
    found = []
    while frame := bench.sent():
        if frame.arbitration_id == REQUEST_ID + 1:
            found.append(frame.data)
    return found


def test_block_of_a_request_has_16_frames(bench: NodeBench) -> None:
    message = bytes([0x36]) + bytes(299)
    bench.give(Frame(REQUEST_ID, bytes([0x11, 0x2C]) + message[:6]))
    parts = [message[at : at + 7] for at in range(6, 300, 7)]
    asked = [answers(bench)]
    for number, part in enumerate(parts, start=1):
        bench.give(Frame(REQUEST_ID, bytes([0x20 | number % 16]) + part))
        asked.append(answers(bench))
    flow = bytes.fromhex("301000cccccccccc")
    assert [number for number, sent in enumerate(asked) if flow in sent] == [0, 16, 32]


@pytest.mark.parametrize(("passed", "arrives"), [(999, True), (1000, False)])
def test_frame_of_a_request_may_come_within_a_second(bench: NodeBench, passed: int, arrives: bool) -> None:
    bench.give(Frame(REQUEST_ID, bytes.fromhex("100836010203ffff")))
    assert [sent[0] for sent in answers(bench)] == [0x30]
    bench.tick(passed, step=1)
    bench.give(Frame(REQUEST_ID, bytes.fromhex("21ffff")))
    assert (bytes([3, 0x7F, 0x36, Nrc.SEQUENCE]) in [sent[:4] for sent in answers(bench)]) == arrives


@pytest.mark.parametrize(("waits", "heard"), [(8, True), (9, False)])
def test_eight_waits_of_the_master_are_borne(bench: NodeBench, waits: int, heard: bool) -> None:
    bench.give(Frame(REQUEST_ID, b"\x03\x22\x01\x00"))
    assert [sent[0] >> 4 for sent in answers(bench)] == [1]
    for _ in range(waits):
        bench.give(Frame(REQUEST_ID, b"\x31\0\0"))
    bench.give(Frame(REQUEST_ID, b"\x30\0\0"))
    assert bool(answers(bench)) == heard


@pytest.mark.parametrize(("passed", "heard"), [(999, True), (1000, False)])
def test_answer_waits_a_second_for_flow_control(bench: NodeBench, passed: int, heard: bool) -> None:
    bench.give(Frame(REQUEST_ID, b"\x03\x22\x01\x00"))
    assert [sent[0] >> 4 for sent in answers(bench)] == [1]
    bench.tick(passed, step=1)
    bench.give(Frame(REQUEST_ID, b"\x30\0\0"))
    assert bool(answers(bench)) == heard


def test_refused_request_is_answered_on_the_bus(bench: NodeBench) -> None:
    bench.stop(True)
    bench.give(Frame(REQUEST_ID, b"\x07\x34\x00\x44\0\0\0\1"))
    assert answers(bench)[0][:4] == bytes((3, 0x7F, 0x34, 0x13))
    assert bench.clear(HEAD, 1) == -Nrc.CONDITIONS


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
