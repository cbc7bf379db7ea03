"""Interlocks that the nodes of the bench enforce by themselves, by their own time stamps; their self test."""

from __future__ import annotations

import ctypes
import zlib
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from inkloop_hardware.protocol.records import Fault
from inkloop_hardware.protocol.services import Routine
from support.benches.node_bench import (
    CURE,
    DONE,
    DONE_BEFORE,
    GATE,
    HEAD,
    LAMP,
    MOTION,
    NEVER,
    PROFILER,
    STAGE,
    Broken,
    MasterAlive,
    NodeBench,
    Nrc,
    pattern_blob,
)

FULL = np.ones((9, 8), np.uint8)
LONG = 5000
GATE_LIMIT = 500  # ms
ALIVE = 300  # ms without MasterAlive, in ticks of 5 ms; 350 ms are promised
CONTRADICTION = Broken.GATE_STAYS_OPEN | Broken.GATE_STAYS_CLOSED
"""Both end switches of the gate are true: one of them is wrong, and which one is not known."""
OTHER = MasterAlive(LAMP | GATE | MOTION, 2, 7)


@pytest.fixture
def bench() -> Iterator[NodeBench]:
    with NodeBench(pass_ms=LONG) as made:
        made.ready()
        assert made.download(pattern_blob(FULL), 1) == 0
        yield made


def begin_pass(bench: NodeBench) -> None:
    assert bench.raw(bench.routine(Routine.PASS, 1, 0, option=b"\x00")) == b"\x7f\x31\x78"
    bench.tick(200)
    assert bench.state().state == "PRINTING"


def begin_cure(bench: NodeBench, milliseconds: int = LONG) -> None:
    request = bench.routine(Routine.CURE, 1, 0, option=milliseconds.to_bytes(2, "big"))
    assert bench.raw(request, CURE) == b"\x7f\x31\x78"
    bench.tick(200)
    assert bench.state(CURE).state == "CURING"


def off_after(bench: NodeBench, node: int) -> tuple[str, int]:
    """State after half a second, and the fault; the request under way has got its answer."""
    bench.tick(500)
    assert bench.late(node)[:3] == bytes((0x7F, 0x31, Nrc.FAILED))
    return bench.state(node).state, bench.state(node).cause


BEGIN = {HEAD: begin_pass, CURE: begin_cure}


def distrust(bench: NodeBench, node: int) -> None:
    bench.c.node_supervision(bench.node(node), bench.clock, False)


Happening = Callable[[NodeBench, int], object]
ENDINGS: dict[str, tuple[Happening, tuple[int, ...], tuple[str, int], int, int]] = {
    "master lost": (
        lambda b, _: setattr(b, "master", None),
        (HEAD, CURE),
        ("SAFE", Fault.MASTER_LOST),
        ALIVE - 100,
        ALIVE + 5,
    ),
    "no lamp": (
        lambda b, _: setattr(b.master, "enables", GATE | MOTION),
        (CURE,),
        ("SAFE", Fault.ENABLE_DROPPED),
        1,
        100,
    ),
    "no gate": (
        lambda b, _: setattr(b.master, "enables", LAMP | MOTION),
        (HEAD,),
        ("SAFE", Fault.ENABLE_DROPPED),
        1,
        100,
    ),
    "stop": (lambda b, _: b.stop(True), (HEAD, CURE), ("SAFE", Fault.STOP_REQUEST), 0, 0),
    "two masters": (lambda b, _: b.send_keep_alive(OTHER), (HEAD, CURE), ("SAFE", Fault.TWO_MASTERS), 0, 0),
    "mistrusted master": (distrust, (HEAD, CURE), ("SAFE", Fault.SUPERVISION), 0, 0),
    "gate opens": (lambda b, _: b.broken(Broken.GATE_STAYS_OPEN), (CURE,), ("FAULT", Fault.GATE_NOT_CONFIRMED), 5, 5),
    "contradiction": (lambda b, _: b.broken(CONTRADICTION), (HEAD, CURE), ("FAULT", Fault.GATE_NOT_CONFIRMED), 5, 5),
    "lamp comes on": (lambda b, _: b.broken(Broken.LAMP_STAYS_ON), (HEAD,), ("FAULT", Fault.LAMP_TIME), 5, 5),
}
"""Event, the node in whose step it comes, the end, and the milliseconds until everything is off."""


@pytest.mark.parametrize(("name", "node"), [(name, node) for name, ending in ENDINGS.items() for node in ending[1]])
def test_step_is_ended_in_time_and_unknown_and_a_person_has_to_look(bench: NodeBench, name: str, node: int) -> None:
    happen, _, end, soonest, latest = ENDINGS[name]
    BEGIN[node](bench)
    began = bench.clock
    happen(bench, node)
    bench.tick(500)
    times = bench.times(node)
    assert soonest <= (times.gate_closed if node == HEAD else times.lamp_off) - began <= latest
    assert times.off == times.lamp_off if node == CURE else times.off == times.gate_closed
    assert bench.late(node)[:3] == bytes((0x7F, 0x31, Nrc.FAILED))
    assert bench.state_and_cause(node) == end
    assert bench.state(HEAD).unknown == (node == HEAD)
    if end[1] == Fault.ENABLE_DROPPED:
        assert bench.state(CURE if node == HEAD else HEAD).state != "SAFE", "what did not need it continues"
    bench.stop(False)
    bench.broken(0)
    bench.master = MasterAlive(LAMP | GATE | MOTION, 1, 7)
    bench.tick(400)
    bench.c.node_supervision(bench.node(node), bench.clock, True)
    assert bench.clear(node) == -Nrc.CONDITIONS
    assert bench.clear(node, 1) == DONE


def test_new_session_between_two_ticks_takes_over_no_step(bench: NodeBench) -> None:
    """The old master is silent for its limit, and no tick has seen it yet."""
    begin_cure(bench)
    bench.clock = bench.last_alive + ALIVE
    bench.send_keep_alive(OTHER)
    assert bench.state_and_cause(CURE) == ("SAFE", Fault.MASTER_LOST)
    assert bench.times(CURE).lamp_off == bench.clock


@pytest.mark.parametrize("name", ["stop", "two masters", "mistrusted master"])
def test_node_stays_off_as_long_as_its_cause_lasts(bench: NodeBench, name: str) -> None:
    ENDINGS[name][0](bench, CURE)
    assert bench.clear(CURE, 1) == -Nrc.CONDITIONS
    assert bench.state(CURE).state == "SAFE"


@pytest.mark.parametrize("broken", [0, Broken.GATE_STAYS_OPEN, CONTRADICTION, Broken.NOT_READY, Broken.LAMP_STAYS_ON])
def test_what_is_not_safe_is_refused_and_not_begun(bench: NodeBench, broken: int) -> None:
    """0: without an enable."""
    bench.master = MasterAlive((LAMP | GATE | MOTION) if broken else 0, 1, 7)
    bench.tick(100)
    bench.broken(broken)
    asked = [bench.jet(1), bench.run(Routine.SELF_TEST, HEAD, option=b"\0\0")]
    if broken not in (Broken.NOT_READY, Broken.LAMP_STAYS_ON):
        asked += [bench.cure(1), bench.run(Routine.SELF_TEST, CURE, option=b"\0\x64")]
    if not broken:
        asked.append(bench.run(Routine.HOME, STAGE, attempt=2))
    if broken == Broken.NOT_READY:
        assert asked.pop() == DONE, "a gate needs no ink"
    assert asked == [-Nrc.CONDITIONS] * len(asked)
    assert bench.lamp_pulses == 0
    assert bench.gate_openings == (broken == Broken.NOT_READY)
    assert (bench.state().state, bench.state().unknown) == ("VERIFIED", 0)


def test_lamp_and_open_gate_exclude_each_other(bench: NodeBench) -> None:
    begin_cure(bench)
    assert bench.jet(1) == -Nrc.CONDITIONS
    bench.tick(LONG)
    begin_pass(bench)
    assert bench.cure(1, 1) == -Nrc.CONDITIONS
    assert bench.lamp_with_gate == 0


@pytest.mark.parametrize("broken", [Broken.GATE_STAYS_CLOSED, CONTRADICTION])
def test_gate_that_is_not_confirmed_open_ends_the_pass_before_a_droplet(bench: NodeBench, broken: int) -> None:
    assert bench.raw(bench.routine(Routine.PASS, 1, 0, option=b"\0")) == b"\x7f\x31\x78"
    bench.tick()
    bench.broken(broken)
    bench.tick(LONG)
    assert bench.late()[2] == Nrc.FAILED
    assert (bench.state().state, bench.state().cause, bench.state().unknown) == ("FAULT", Fault.GATE_NOT_CONFIRMED, 1)
    assert not bench.surface.any()


@pytest.mark.parametrize("broken", [Broken.GATE_STAYS_OPEN, CONTRADICTION])
def test_gate_that_is_not_confirmed_closed_is_a_fault_but_the_pass_is_done(bench: NodeBench, broken: int) -> None:
    begin_pass(bench)
    while not bench.state().done:
        bench.tick()
    bench.broken(broken)
    bench.tick(2000)
    assert bench.state_and_cause() == ("FAULT", Fault.GATE_NOT_CONFIRMED)
    assert (bench.state().done, bench.state().unknown) == (1, 0)


DEVICES = {
    Routine.HOME: (b"", STAGE, Fault.STAGE_POSITION),
    Routine.MOVE: (b"\1", STAGE, Fault.STAGE_POSITION),
    Routine.PURGE: (b"", HEAD, Fault.BACK_PRESSURE),
    Routine.PASS: (b"\0", HEAD, Fault.BACK_PRESSURE),
    Routine.SCAN: (b"", PROFILER, Fault.SCAN_FAILED),
}


@pytest.mark.parametrize("routine", DEVICES)
@pytest.mark.parametrize("how", ["refuses", "fails", "hangs", "cannot be kept"])
def test_device_that_fails_is_a_fault_that_names_it(bench: NodeBench, routine: Routine, how: str) -> None:
    option, node, cause = DEVICES[routine]
    if how == "refuses":
        bench.refuse_work(node)
    bench.broken(
        {"fails": Broken.WORK_FAILS, "hangs": Broken.WORK_HANGS, "cannot be kept": Broken.STORAGE_FULL}.get(how, 0)
    )
    if how == "hangs" and routine in (Routine.PASS, Routine.SCAN):  # their limits have tests of their own
        return
    answers = [bench.raw(bench.routine(routine, 1, attempt=2, option=option), node)]
    bench.tick(40_000 if how == "hangs" else LONG + 1000, step=25)
    answers += [bench.late(node), bench.late(node)]
    assert answers == [b"\x7f\x31\x78", bytes((0x7F, 0x31, Nrc.FAILED)), b""]
    expected = {"hangs": Fault.STEP_EXPIRED, "cannot be kept": Fault.STORAGE_FAILED}.get(how, cause)
    assert bench.state_and_cause(node) == ("FAULT", expected)
    assert bench.state().unknown == (routine == Routine.PASS), "a pass whose trace is lost counts as unknown"
    bench.broken(0)
    if how != "refuses":
        assert bench.clear(node, 1) == DONE


@pytest.mark.parametrize(("passed", "state"), [(ALIVE - 1, "CURING"), (ALIVE, "SAFE")])
def test_master_counts_as_lost_in_the_very_millisecond(bench: NodeBench, passed: int, state: str) -> None:
    begin_cure(bench)
    bench.send_keep_alive()
    bench.master = None
    bench.tick(passed, step=1)
    assert bench.state(CURE).state == state


@pytest.mark.parametrize(("passed", "outcome"), [(ALIVE - 1, -Nrc.CONDITIONS), (ALIVE, DONE)])
def test_second_master_counts_as_silent_in_the_very_millisecond(bench: NodeBench, passed: int, outcome: int) -> None:
    bench.send_keep_alive(MasterAlive(LAMP | GATE | MOTION, 2, 7))
    for _ in range(passed):
        bench.tick(1, step=1)
        if bench.clock % 50 == 0:
            bench.send_keep_alive()
    assert bench.clear(CURE, 1) == outcome


def test_gate_stays_closed_where_the_lamp_comes_on_between_the_request_and_the_opening(bench: NodeBench) -> None:
    """An intent is recorded in between, which takes as long as the flash does."""
    bench.light_while_recording()
    assert bench.jet(1) == -Nrc.FAILED
    assert bench.gate_openings == 0
    assert bench.state().state == "FAULT"


def test_gate_that_leaves_its_stop_while_the_lamp_is_on_is_counted(bench: NodeBench) -> None:
    """Also before it is open."""
    begin_cure(bench)
    bench.c.probe_move_gate(bench.bench, 1)
    assert bench.lamp_with_gate == 1


def test_lamp_that_stays_on_is_a_fault(bench: NodeBench) -> None:
    """The time of a step counts from its beginning, not from its last phase."""
    begin_cure(bench, 300)
    bench.broken(Broken.LAMP_STAYS_ON)
    bench.tick(1000)
    assert bench.state_and_cause(CURE) == ("FAULT", Fault.STEP_EXPIRED)
    assert bench.times(CURE).off - bench.times(CURE).lamp_on == 300 + GATE_LIMIT
    assert bench.raw(bench.routine(Routine.CURE, 1, kind=3), CURE)[4] == DONE_BEFORE, "the ink got all of its light"


def test_lamp_goes_out_in_the_very_millisecond_of_its_limit() -> None:
    """By MasterAlive alone, where the loop of the node hangs that would have ended the step."""
    with NodeBench(lamp_limit_ms=1000) as bench:
        bench.ready()
        bench.raw(bench.routine(Routine.CURE, 1, 0, option=(900).to_bytes(2, "big")), CURE)
        bench.tick()
        for passed in (200, 200, 200, 200, 199):
            bench.clock += passed
            bench.send_keep_alive()
        assert bench.state(CURE).state == "CURING"
        bench.clock += 1
        bench.send_keep_alive()
        assert bench.state_and_cause(CURE) == ("FAULT", Fault.LAMP_TIME)
        assert bench.times(CURE).lamp_off == bench.clock


def test_journal_that_fails_in_a_fault_is_the_fault_that_is_reported(bench: NodeBench) -> None:
    """A record that the node cannot write outlasts its fault."""
    begin_pass(bench)
    bench.tear(5)
    bench.broken(Broken.GATE_STAYS_CLOSED)
    assert off_after(bench, HEAD) == ("FAULT", Fault.JOURNAL_DAMAGED)


@pytest.mark.parametrize(("routine", "option"), [(Routine.HOME, b""), (Routine.MOVE, b"\1")])
def test_stage_needs_motion_all_the_way(routine: int, option: bytes) -> None:
    with NodeBench(home_ms=LONG, move_ms=LONG) as bench:
        assert bench.ready().raw(bench.routine(routine, attempt=2, option=option), STAGE)[2] == Nrc.PENDING
        bench.tick(200)
        assert not bench.late(STAGE)
        bench.master = MasterAlive(LAMP | GATE, 1, 7)
        assert off_after(bench, STAGE) == ("SAFE", Fault.ENABLE_DROPPED)


@pytest.mark.parametrize("broken", [0, Broken.WORK_HANGS], ids=["cut off", "hung"])
def test_stage_whose_homing_was_given_up_is_not_homed(broken: int) -> None:
    with NodeBench(home_ms=100 if broken else LONG) as bench:
        bench.tick(100)
        assert bench.clear(STAGE) == DONE
        bench.broken(broken)
        assert bench.raw(bench.routine(Routine.HOME), STAGE)[2] == Nrc.PENDING
        bench.tick(200)
        bench.stop(True)
        bench.stop(False)
        bench.broken(0)
        assert bench.clear(STAGE, 1) == DONE
        assert bench.run(Routine.MOVE, STAGE, option=b"\1") == -Nrc.CONDITIONS


def test_fault_stays_whatever_happens_after_it(bench: NodeBench) -> None:
    """A stop request that is released must not make a broken gate look like one that was stopped."""
    begin_cure(bench)
    bench.broken(Broken.GATE_STAYS_OPEN)
    bench.tick()
    fault = ("FAULT", Fault.GATE_NOT_CONFIRMED)
    bench.stop(True)
    assert bench.state_and_cause(CURE) == fault
    bench.stop(False)
    bench.send_keep_alive(MasterAlive(LAMP | GATE | MOTION, 2, 7))
    bench.c.node_supervision(bench.node(CURE), bench.clock, False)
    assert bench.state_and_cause(CURE) == fault


def test_first_cause_of_a_safe_node_is_the_one_that_is_reported(bench: NodeBench) -> None:
    bench.stop(True)
    bench.c.node_supervision(bench.node(CURE), bench.clock, False)
    assert bench.state(CURE).cause == Fault.STOP_REQUEST


def test_dry_run_that_is_stopped_leaves_no_layer_behind() -> None:
    with NodeBench(pass_ms=LONG) as bench:
        bench.ready()
        assert bench.run(Routine.DRY_RUN, option=b"\1") == DONE
        assert bench.download(pattern_blob(FULL), 1) == 0
        begin_pass(bench)
        bench.stop(True)
        bench.stop(False)
        state = bench.state()
        assert (state.layer, state.passes, state.done, state.unknown, state.pattern_crc) == (0, 0, 0, 0, 0)
        assert bench.clear(option=1) == DONE
        assert bench.download(pattern_blob(FULL), 1) == 0, "layer 1 comes first"
        assert bench.jet(1) == DONE
        assert bench.gate_openings == 1, "it is no dry run any more"


def test_one_cure_cures_all_that_lies_there_where_head_and_lamp_are_one_node() -> None:
    with NodeBench(one_node=1) as bench:
        assert bench.ready().download(pattern_blob(FULL), 1) == 0
        for number in (0, 1):
            assert bench.jet(1, number) == DONE
        assert bench.cure(1, 1) == DONE
        assert bench.state().cured == 0b11


def test_node_says_that_it_is_still_busy_now_and_then() -> None:
    with NodeBench(scan_ms=20_000) as bench:
        assert bench.ready().raw(bench.routine(Routine.SCAN), PROFILER)[2] == Nrc.PENDING
        said = []
        for _ in range(100):
            bench.tick(100, step=25)
            said.append(bench.late(PROFILER)[2:] == bytes([Nrc.PENDING]))
        assert sum(said) == 10, "each second"


def test_answer_that_was_not_fetched_is_not_that_of_the_next_step(bench: NodeBench) -> None:
    assert bench.raw(bench.routine(Routine.HOME, attempt=2), STAGE)[2] == Nrc.PENDING
    bench.tick(100)
    assert bench.state(STAGE).step == 0
    assert bench.raw(bench.routine(Routine.MOVE, attempt=2, option=b"\1"), STAGE)[2] == Nrc.PENDING
    assert bench.late(STAGE) == b""
    bench.tick(100)
    assert bench.late(STAGE)[2:4] == Routine.MOVE.to_bytes(2, "big")


@pytest.mark.parametrize(("third", "outcome"), [(False, DONE), (True, -Nrc.CONDITIONS)])
def test_second_master_that_is_adopted_is_the_only_one_unless_there_is_a_third(
    bench: NodeBench, third: bool, outcome: int
) -> None:
    bench.master = MasterAlive(LAMP | GATE | MOTION, 2, 7)
    bench.send_keep_alive()
    assert bench.state(CURE).cause == Fault.TWO_MASTERS
    for _ in range(4):
        bench.tick(100)
        if third:
            bench.send_keep_alive(MasterAlive(LAMP | GATE | MOTION, 3, 7))
    assert bench.state(CURE).session == 2, "the first one is silent"
    assert bench.clear(CURE, 1) == outcome


WRAP = 1 << 32
"""Milliseconds after which the clock of a node shows the same number again: 49.7 days."""


@pytest.fixture
def unwatched() -> Iterator[NodeBench]:
    """The clock may jump: no watchdog waits for the ticks in between."""
    with NodeBench(watchdog_ms=0) as made:
        yield made.ready()


def test_other_master_that_fell_silent_is_not_alive_when_the_clock_shows_the_same_number_again(
    unwatched: NodeBench,
) -> None:
    bench = unwatched
    bench.send_keep_alive(MasterAlive(LAMP | GATE | MOTION, 2, 7))
    heard_at = bench.clock
    bench.tick(400)
    bench.clock = bench.last_alive = heard_at + WRAP - 50
    bench.tick(100)
    assert bench.clear(CURE, 1) == DONE
    bench.tick(100)
    assert bench.state(CURE).state == "IDLE"


@pytest.mark.parametrize(("one_node", "expected"), [(0, ("SCANNING", 0)), (1, ("SAFE", Fault.ENABLE_DROPPED))])
def test_scan_needs_motion_all_the_time_where_profiler_and_stage_are_one_node(one_node: int, expected: Any) -> None:
    node = HEAD if one_node else PROFILER
    with NodeBench(one_node=one_node, scan_ms=LONG) as bench:
        bench.ready().master = MasterAlive(LAMP | GATE, 1, 7)
        bench.tick(100)
        refused = bench.raw(bench.routine(Routine.SCAN), node)[2]
        assert refused == (Nrc.CONDITIONS if one_node else Nrc.PENDING)
        bench.master = MasterAlive(MOTION, 1, 7)
        bench.tick(100)
        assert bench.raw(bench.routine(Routine.SCAN), node)[2] == Nrc.PENDING
        bench.tick(200)
        bench.master = MasterAlive(LAMP | GATE, 1, 7)
        bench.tick(500)
        assert bench.state_and_cause(node) == expected


@pytest.mark.parametrize("one_node", [0, 1])
def test_dry_run_needs_motion_alone(one_node: int) -> None:
    """Neither lamp nor gate is switched; a stage moves."""
    head, cure = (HEAD, HEAD) if one_node else (HEAD, CURE)
    with NodeBench(one_node=one_node, pass_ms=LONG) as bench:
        bench.ready()
        for node in {head, cure}:
            assert bench.run(Routine.DRY_RUN, node, option=b"\1") == DONE
        bench.master = MasterAlive(MOTION, 1, 7)
        bench.tick(100)
        assert bench.download(pattern_blob(FULL, passes=1), 1) == 0
        assert bench.raw(bench.routine(Routine.PASS, 1, option=b"\xff")) == b"\x7f\x31\x78"
        bench.broken(Broken.GATE_STAYS_OPEN)
        bench.tick(LONG + 100)
        assert bench.late()[4] == DONE
        bench.broken(0)
        assert bench.raw(bench.routine(Routine.CURE, 1, option=b"\x01\xf4"), cure) == b"\x7f\x31\x78"
        bench.tick(1000)
        assert bench.late(cure)[4] == DONE
        assert bench.gate_openings == bench.lamp_pulses == 0


@pytest.mark.parametrize(
    ("node", "milliseconds", "own", "others"), [(HEAD, 0, GATE, LAMP | MOTION), (CURE, LONG, LAMP, GATE | MOTION)]
)
def test_self_test_needs_the_enable_of_what_it_switches(node: int, milliseconds: int, own: int, others: int) -> None:
    with NodeBench(gate_ms=300) as bench:
        bench.ready()
        request = bench.routine(Routine.SELF_TEST, option=milliseconds.to_bytes(2, "big"))
        bench.master = MasterAlive(others, 1, 7)
        bench.tick(100)
        assert bench.raw(request, node)[:3] == bytes((0x7F, 0x31, Nrc.CONDITIONS))
        bench.master = MasterAlive(own, 1, 7)
        bench.tick(100)
        assert bench.raw(request, node) == b"\x7f\x31\x78"
        bench.tick(200)
        assert bench.state(node).state == "IDLE"
        bench.master = MasterAlive(others, 1, 7)
        assert off_after(bench, node) == ("SAFE", Fault.ENABLE_DROPPED)


def test_lamp_node_that_switches_off_closes_the_gate_as_well(bench: NodeBench) -> None:
    begin_pass(bench)
    bench.c.node_supervision(bench.node(CURE), bench.clock, False)
    bench.tick()
    assert bench.state_and_cause() == ("FAULT", Fault.GATE_NOT_CONFIRMED)
    assert bench.state(CURE).state == "SAFE"


@pytest.mark.parametrize(("node", "begin"), [(HEAD, begin_pass), (CURE, begin_cure)])
def test_time_of_switching_off_is_that_of_the_first_cause(bench: NodeBench, node: int, begin) -> None:
    begin(bench)
    bench.stop(True)
    first = bench.clock
    bench.tick(100)
    bench.stop(True)
    bench.master = None
    bench.tick(500)
    times = bench.times(node)
    assert (times.off, times.gate_closed if node == HEAD else times.lamp_off) == (first, first)


def test_time_of_a_fault_is_its_own_also_where_the_node_was_safe(bench: NodeBench) -> None:
    bench.stop(True)
    bench.stop(False)
    bench.tick(100)
    bench.tear(5)
    assert bench.clear(HEAD, 1) == -Nrc.FAILED
    assert bench.state_and_cause() == ("FAULT", Fault.JOURNAL_DAMAGED)
    assert bench.times().off == bench.clock


def test_what_was_transferred_or_scanned_is_gone_after_a_stop(bench: NodeBench) -> None:
    """An exit that is repeated must not say that the pattern is there, nor the profiler that its map is."""
    repeated = b"\x37" + zlib.crc32(pattern_blob(FULL)).to_bytes(4, "big")
    assert bench.raw(repeated)[0] == 0x77
    assert bench.scan(0) == DONE
    bench.stop(True)
    bench.stop(False)
    assert bench.clear(HEAD, 1) == bench.clear(PROFILER, 1) == DONE
    assert bench.raw(repeated) == bytes((0x7F, 0x37, Nrc.SEQUENCE))
    assert not bench.state().pattern_loaded
    assert bench.jet(1) == -Nrc.SEQUENCE
    assert bench.raw(b"\x22\x01\x00", PROFILER)[6] & 16 == 0
    assert bench.raw(bench.routine(Routine.SCAN, kind=3), PROFILER)[4] == NEVER
    assert bench.raw(b"\x22\x01\x03", PROFILER)[3:7] == bytes(4)


@pytest.mark.parametrize(
    ("routine", "option", "node", "times", "end"),
    [
        (Routine.PASS, b"\0", HEAD, {"pass_ms": 119_900, "gate_ms": 400}, ("PRINTED", 0)),
        (Routine.PASS, b"\0", HEAD, {"pass_ms": 121_100}, ("FAULT", Fault.STEP_EXPIRED)),
        (Routine.SCAN, b"", PROFILER, {"scan_ms": 59_900}, ("MAP_READY", 0)),
        (Routine.SCAN, b"", PROFILER, {"scan_ms": 60_100}, ("FAULT", Fault.STEP_EXPIRED)),
        (Routine.CURE, b"\x03\x84", CURE, {"lamp_limit_ms": 901}, ("CURED", 0)),
    ],
)
def test_step_may_take_its_limit_and_no_longer(
    routine: int, option: bytes, node: int, times: dict[str, Any], end: tuple[str, int]
) -> None:
    """A pass the ways of the gate in addition."""
    with NodeBench(**times) as bench:
        assert bench.ready().download(pattern_blob(FULL), 1) == 0
        assert bench.cure(1, milliseconds=int(times.get("lamp_limit_ms", 10_000))) == bench.cure(1, milliseconds=0)
        assert bench.cure(1, milliseconds=0) == -Nrc.RANGE
        assert bench.raw(bench.routine(routine, 1, 0, option=option), node)[2] == Nrc.PENDING
        bench.tick(121_100, step=25)
        assert bench.state_and_cause(node) == end
        if node == CURE:
            assert 900 <= bench.times(CURE).lamp_off - bench.times(CURE).lamp_on <= 925


def test_idle_nodes_go_safe_without_a_master_and_resume_without_a_person(bench: NodeBench) -> None:
    bench.master = None
    bench.tick(400)
    assert {bench.state_and_cause(node) for node in range(4)} == {("SAFE", Fault.MASTER_LOST)}
    bench.master = OTHER
    bench.tick(100)
    assert [bench.clear(node) for node in range(4)] == [DONE] * 4
    assert bench.state(CURE).session == 2


OF_THE_GATE, OF_THE_LAMP = b"\x00\x00", b"\x00\x64"


def test_gate_goes_to_both_ends_and_the_lamp_lights_with_it_closed(bench: NodeBench) -> None:
    before = bench.surface.copy()
    assert bench.run(Routine.SELF_TEST, HEAD, option=OF_THE_GATE) == DONE
    assert bench.run(Routine.SELF_TEST, CURE, option=OF_THE_LAMP) == DONE
    assert bench.gate_openings == 1
    assert bench.lamp_pulses == 1
    assert bench.lamp_with_gate == 0
    times = bench.times(CURE)
    assert 100 <= times.lamp_off - times.lamp_on < 110
    np.testing.assert_array_equal(bench.surface, before)


def test_layer_under_way_and_journals_do_not_know_of_it(bench: NodeBench) -> None:
    assert bench.download(pattern_blob(FULL), 1) == 0
    assert bench.jet(1) == DONE
    before = [(bench.journal(node), bench.state(node).done, bench.state(node).state) for node in (HEAD, CURE)]
    assert bench.run(Routine.SELF_TEST, HEAD, option=OF_THE_GATE) == DONE
    assert bench.run(Routine.SELF_TEST, CURE, option=OF_THE_LAMP) == DONE
    assert [(bench.journal(n), bench.state(n).done, bench.state(n).state) for n in (HEAD, CURE)] == before
    assert bench.cure(1) == DONE
    assert bench.jet(1, 1) == DONE


@pytest.mark.parametrize(
    ("broken", "node", "option", "cause"),
    [
        (Broken.GATE_STAYS_CLOSED, HEAD, OF_THE_GATE, Fault.GATE_NOT_CONFIRMED),
        (Broken.GATE_STAYS_OPEN, HEAD, OF_THE_GATE, Fault.GATE_NOT_CONFIRMED),
        (Broken.LAMP_STAYS_ON, CURE, OF_THE_LAMP, Fault.LAMP_TIME),
        (Broken.LAMP_STAYS_OFF, CURE, OF_THE_LAMP, Fault.LAMP_TIME),
    ],
)
def test_what_is_not_confirmed_is_a_fault_with_everything_off(
    broken: int, node: int, option: bytes, cause: int, bench: NodeBench
) -> None:
    assert bench.raw(bench.routine(Routine.SELF_TEST, option=option), node)[2] == 0x78
    bench.broken(broken)
    bench.tick(1500)
    assert bench.late(node)[:3] == bytes((0x7F, 0x31, Nrc.FAILED))
    state = bench.state(node)
    assert (state.state, state.cause, state.needs_operator) == ("FAULT", cause, True)
    times = bench.times(node)
    assert times.lamp_off >= times.lamp_on
    assert times.gate_closed >= times.gate_opened


def test_what_a_node_does_not_have_it_does_not_test(bench: NodeBench) -> None:
    assert bench.run(Routine.SELF_TEST, CURE, option=OF_THE_GATE) == -Nrc.RANGE
    assert bench.run(Routine.SELF_TEST, HEAD, option=OF_THE_LAMP) == -Nrc.RANGE


def test_new_session_leaves_a_node_that_is_off_its_cause(bench: NodeBench) -> None:
    bench.stop(True)
    bench.stop(False)
    bench.master = None
    bench.tick(400)
    assert bench.state_and_cause(CURE) == ("SAFE", Fault.STOP_REQUEST)
    bench.send_keep_alive(OTHER)
    assert bench.state_and_cause(CURE) == ("SAFE", Fault.STOP_REQUEST)
    assert bench.state(CURE).session == 2


def test_power_up_is_the_time_at_which_all_went_off() -> None:
    with NodeBench(clock=5000) as bench:
        for node in range(4):
            times = bench.times(node)
            assert (times.off, times.lamp_off, times.gate_closed) == (5000, 5000, 5000)
            assert (times.lamp_on, times.gate_opened, times.master_alive) == (0, 0, 0)


def test_late_answer_waits_for_room(bench: NodeBench) -> None:
    assert bench.raw(bench.routine(Routine.HOME, attempt=2), STAGE)[2] == Nrc.PENDING
    bench.tick(100)
    answer = ctypes.create_string_buffer(64)

    def taken(room: int) -> int:
        return int(bench.c.node_take_answer(bench.node(STAGE), answer, ctypes.c_size_t(room)))

    assert [taken(room) for room in (0, 12, 13, 64)] == [0, 0, 13, 0]
    assert answer.raw[:5] == b"\x71\x01\x02\x01" + bytes([DONE])


@pytest.mark.parametrize("milliseconds", [100, 101])
def test_lamp_of_a_self_test_burns_as_long_as_that_lasts(milliseconds: int) -> None:
    with NodeBench() as bench:
        bench.ready()
        option = milliseconds.to_bytes(2, "big")
        assert bench.raw(bench.routine(Routine.SELF_TEST, option=option), CURE)[2] == Nrc.PENDING
        bench.tick(milliseconds + 50, step=1)
        assert bench.late(CURE)[4] == DONE
        assert bench.times(CURE).lamp_off - bench.times(CURE).lamp_on == milliseconds


def test_self_test_may_take_the_way_of_the_gate_twice() -> None:
    with NodeBench(gate_ms=GATE_LIMIT - 10) as bench:
        bench.tick(600)
        for node in range(4):
            assert bench.clear(node) == DONE
        assert bench.run(Routine.SELF_TEST, HEAD, option=b"\0\0") == DONE


def test_lamp_and_gate_exclude_each_other_also_where_one_is_driven_without_a_step(bench: NodeBench) -> None:
    """By a flipped bit of the memory, between the request and the switching."""
    request = bench.routine(Routine.CURE, 1, option=b"\x01\x00")
    bench.c.probe_drive_gate(bench.bench, CURE)
    assert bench.raw(request, CURE) == bytes((0x7F, 0x31, Nrc.CONDITIONS))
    bench.stop(True)
    bench.stop(False)
    assert bench.clear(CURE, 1) == DONE
    assert bench.state_and_cause(CURE) == ("IDLE", 0), "what was cleared has no cause"
    assert bench.raw(request, CURE) == b"\x7f\x31\x78"
    bench.c.probe_drive_gate(bench.bench, CURE)
    bench.tick(10)
    assert bench.state_and_cause(CURE) == ("FAULT", Fault.GATE_NOT_CONFIRMED)
    bench.c.probe_drive_lamp(bench.bench, HEAD)
    assert bench.run(Routine.SELF_TEST, HEAD, option=OF_THE_GATE) == -Nrc.CONDITIONS
    bench.stop(True)
    bench.stop(False)
    bench.tick(100)
    assert bench.clear(HEAD, 1) == DONE
    assert bench.download(pattern_blob(FULL), 1) == 0
    assert bench.raw(bench.routine(Routine.PASS, 1, option=b"\0")) == b"\x7f\x31\x78"
    bench.c.probe_drive_lamp(bench.bench, HEAD)
    bench.tick(10)
    assert bench.state().state == "FAULT"
    assert bench.gate_openings == bench.lamp_pulses == 0
