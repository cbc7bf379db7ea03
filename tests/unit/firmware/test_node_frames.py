"""The frames that a node sends on its bus: what stands in its status and faults, when they come, and its ISO-TP."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from inkloop_hardware.protocol.codec import COUNTERS, Codec, Frame
from inkloop_hardware.protocol.records import NodeFault, NodeStatus, Record, unpack
from inkloop_hardware.protocol.services import Routine
from inkloop_hardware.protocol.vocabulary import Fault, Node, State
from support.benches.node_bench import CURE, DONE, HEAD, PROFILER, STAGE, NodeBench, Nrc, pattern_blob

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
    for now in range(2600):
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
