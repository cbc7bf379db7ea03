"""Interlocks that the nodes of the bench enforce by themselves, by their own time stamps."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from support.benches.node_bench import (
    BACK_PRESSURE,
    CURE,
    CURE_ROUTINE,
    DONE,
    DONE_BEFORE,
    DRY_RUN,
    ENABLE_DROPPED,
    GATE,
    GATE_NOT_CONFIRMED,
    GATE_OPENINGS,
    GATE_STAYS_CLOSED,
    GATE_STAYS_OPEN,
    HEAD,
    HOME,
    JOURNAL_DAMAGED,
    LAMP,
    LAMP_PULSES,
    LAMP_STAYS_OFF,
    LAMP_STAYS_ON,
    LAMP_TIME,
    LAMP_WITH_GATE,
    MASTER_LOST,
    MOTION,
    MOVE,
    NOT_READY,
    NRC_CONDITIONS,
    NRC_FAILED,
    NRC_PENDING,
    NRC_RANGE,
    NRC_SEQUENCE,
    PASS,
    PROFILER,
    PURGE,
    SCAN,
    SCAN_FAILED,
    SELF_TEST,
    STAGE,
    STAGE_POSITION,
    STEP_EXPIRED,
    STOP_REQUEST,
    STORAGE_FAILED,
    STORAGE_FULL,
    SUPERVISION,
    TWO_MASTERS,
    WORK_FAILS,
    WORK_HANGS,
    MasterAlive,
    NodeBench,
    pattern_blob,
)

FULL = np.ones((9, 8), np.uint8)
LONG = 5000
GATE_LIMIT = 500  # ms
ALIVE = 300  # ms without MasterAlive, in ticks of 5 ms; 350 ms are promised


@pytest.fixture
def bench() -> Iterator[NodeBench]:
    with NodeBench(pass_ms=LONG) as made:
        made.ready()
        assert made.download(pattern_blob(FULL), 1) == 0
        yield made


def begin_pass(bench: NodeBench) -> None:
    assert bench.raw(bench.routine(PASS, 1, 0, option=b"\x00")) == b"\x7f\x31\x78"
    bench.tick(200)
    assert bench.state().state == "PRINTING"


def begin_cure(bench: NodeBench, milliseconds: int = LONG) -> None:
    request = bench.routine(CURE_ROUTINE, 1, 0, option=milliseconds.to_bytes(2, "big"))
    assert bench.raw(request, CURE) == b"\x7f\x31\x78"
    bench.tick(200)
    assert bench.state(CURE).state == "CURING"


def off_after(bench: NodeBench, node: int) -> tuple[str, int]:
    """State after half a second, and the fault; the request under way has got its answer."""
    bench.tick(500)
    assert bench.late(node)[:3] == bytes((0x7F, 0x31, NRC_FAILED))
    return bench.state(node).state, bench.state(node).cause


@pytest.mark.parametrize("roles", [0, 1])
def test_every_node_wakes_up_de_energised(roles: int) -> None:
    with NodeBench(one_node=roles) as bench:
        assert {bench.state(node).state for node in range(bench.count)} == {"SAFE"}
        assert bench.counted(GATE_OPENINGS) == bench.counted(LAMP_PULSES) == 0


def test_lamp_is_off_300_ms_after_the_last_master_alive(bench: NodeBench) -> None:
    begin_cure(bench)
    bench.master = None
    assert off_after(bench, CURE) == ("SAFE", MASTER_LOST)
    times = bench.times(CURE)
    assert ALIVE <= times.lamp_off - times.master_alive <= ALIVE + 5
    assert times.off == times.lamp_off


def test_gate_is_closed_300_ms_after_the_last_master_alive(bench: NodeBench) -> None:
    begin_pass(bench)
    bench.master = None
    assert off_after(bench, HEAD) == ("SAFE", MASTER_LOST)
    times = bench.times(HEAD)
    assert ALIVE <= times.gate_closed - times.master_alive <= ALIVE + 5


@pytest.mark.parametrize(("passed", "state"), [(ALIVE - 1, "CURING"), (ALIVE, "SAFE")])
def test_master_counts_as_lost_in_the_very_millisecond(bench: NodeBench, passed: int, state: str) -> None:
    begin_cure(bench)
    bench.send_keep_alive()
    bench.master = None
    bench.tick(passed, step=1)
    assert bench.state(CURE).state == state


@pytest.mark.parametrize(("passed", "outcome"), [(ALIVE - 1, -NRC_CONDITIONS), (ALIVE, DONE)])
def test_second_master_counts_as_silent_in_the_very_millisecond(bench: NodeBench, passed: int, outcome: int) -> None:
    bench.send_keep_alive(MasterAlive(LAMP | GATE | MOTION, 2, 7))
    for _ in range(passed):
        bench.tick(1, step=1)
        if bench.clock % 50 == 0:
            bench.send_keep_alive()
    assert bench.clear(CURE, 1) == outcome


def test_all_nodes_go_safe_when_the_master_is_lost_and_idle_ones_resume_without_a_person(bench: NodeBench) -> None:
    kept, bench.master = bench.master, None
    bench.tick(400)
    assert {(bench.state(node).state, bench.state(node).cause) for node in range(4)} == {("SAFE", MASTER_LOST)}
    bench.master = kept
    bench.tick(100)
    assert [bench.clear(node) for node in range(4)] == [DONE] * 4


def test_lamp_is_off_100_ms_after_its_enable_dropped(bench: NodeBench) -> None:
    begin_cure(bench)
    dropped = bench.clock
    bench.master = MasterAlive(GATE | MOTION, 1, 7)
    assert off_after(bench, CURE) == ("SAFE", ENABLE_DROPPED)
    assert 0 < bench.times(CURE).lamp_off - dropped <= 100
    assert bench.state(HEAD).state == "VERIFIED", "what did not need it continues"


def test_gate_is_closed_100_ms_after_its_enable_dropped(bench: NodeBench) -> None:
    begin_pass(bench)
    dropped = bench.clock
    bench.master = MasterAlive(LAMP | MOTION, 1, 7)
    assert off_after(bench, HEAD) == ("SAFE", ENABLE_DROPPED)
    assert 0 < bench.times(HEAD).gate_closed - dropped <= 100


@pytest.mark.parametrize(("node", "begin"), [(HEAD, begin_pass), (CURE, begin_cure)])
def test_stop_request_acts_at_once_and_stays(bench: NodeBench, node: int, begin) -> None:
    begin(bench)
    asked = bench.clock
    bench.stop(True)
    times = bench.times(node)
    assert (times.gate_closed if node == HEAD else times.lamp_off) == asked
    assert {(bench.state(each).state, bench.state(each).cause) for each in range(4)} == {("SAFE", STOP_REQUEST)}
    bench.tick(100)
    assert bench.clear(node, 1) == -NRC_CONDITIONS, "still asked for"
    bench.stop(False)
    assert bench.state(node).state == "SAFE"
    assert bench.clear(node) == -NRC_CONDITIONS, "no person"
    assert bench.clear(node, 1) == DONE


def test_step_is_refused_without_its_enable(bench: NodeBench) -> None:
    bench.master = MasterAlive(0, 1, 7)
    bench.tick(100)
    assert bench.run(PASS, layer=1, option=b"\x00") == -NRC_CONDITIONS
    assert bench.cure(1) == bench.run(HOME, STAGE, attempt=2) == -NRC_CONDITIONS
    assert bench.counted(GATE_OPENINGS) == bench.counted(LAMP_PULSES) == 0


def test_lamp_is_refused_unless_the_gate_is_confirmed_closed(bench: NodeBench) -> None:
    bench.broken(GATE_STAYS_OPEN)
    assert bench.cure(1) == -NRC_CONDITIONS
    bench.broken(0)
    begin_pass(bench)
    assert bench.cure(1) == -NRC_CONDITIONS
    assert bench.counted(LAMP_PULSES) == 0


def test_lamp_goes_out_in_the_tick_in_which_the_gate_is_not_closed_any_more(bench: NodeBench) -> None:
    begin_cure(bench)
    bench.broken(GATE_STAYS_OPEN)
    seen = bench.clock + 5
    bench.tick()
    assert bench.times(CURE).lamp_off == seen
    assert (bench.state(CURE).state, bench.state(CURE).cause) == ("FAULT", GATE_NOT_CONFIRMED)
    bench.broken(0)
    assert bench.clear(CURE) == -NRC_CONDITIONS
    assert bench.clear(CURE, 1) == DONE


def test_nothing_is_jetted_while_the_lamp_is_on(bench: NodeBench) -> None:
    begin_cure(bench)
    assert bench.run(PASS, layer=1, option=b"\x00") == -NRC_CONDITIONS
    assert bench.counted(LAMP_WITH_GATE) == bench.counted(GATE_OPENINGS) == 0


def test_gate_stays_closed_where_the_lamp_comes_on_between_the_request_and_the_opening(bench: NodeBench) -> None:
    """An intent is recorded in between, which takes as long as the flash does."""
    bench.light_while_recording()
    assert bench.run(PASS, layer=1, option=b"\x00") == -NRC_FAILED
    assert bench.counted(GATE_OPENINGS) == 0
    assert bench.state().state == "FAULT"


def test_gate_that_leaves_its_stop_while_the_lamp_is_on_is_counted(bench: NodeBench) -> None:
    """Also before it is open."""
    begin_cure(bench)
    bench.c.probe_move_gate(bench.bench, 1)
    assert bench.counted(LAMP_WITH_GATE) == 1


def test_lamp_that_comes_on_under_the_open_gate_ends_the_pass(bench: NodeBench) -> None:
    """Whatever lit it: a second later the nozzles would be full of cured ink."""
    begin_pass(bench)
    bench.broken(LAMP_STAYS_ON)
    seen = bench.clock + 5
    bench.tick()
    assert bench.times().gate_closed == seen
    assert (bench.state().state, bench.state().cause, bench.state().unknown) == ("FAULT", LAMP_TIME, 1)


def test_lamp_time_has_a_limit() -> None:
    with NodeBench(lamp_limit_ms=1000) as bench:
        bench.ready()
        assert bench.cure(1, milliseconds=1000) == bench.cure(1, milliseconds=0) == -NRC_RANGE
        began = bench.clock
        assert bench.cure(1, milliseconds=900) == DONE
        assert 900 <= bench.times(CURE).lamp_off - began <= 910


def test_lamp_that_stays_on_is_a_fault(bench: NodeBench) -> None:
    """The time of a step counts from its beginning, not from its last phase."""
    begin_cure(bench, 300)
    bench.broken(LAMP_STAYS_ON)
    bench.tick(1000)
    assert (bench.state(CURE).state, bench.state(CURE).cause) == ("FAULT", STEP_EXPIRED)
    assert bench.times(CURE).off - bench.times(CURE).lamp_on == 300 + GATE_LIMIT
    assert bench.raw(bench.routine(CURE_ROUTINE, 1, kind=3), CURE)[4] == DONE_BEFORE, "the ink got all of its light"


def test_lamp_goes_out_in_the_very_millisecond_of_its_limit() -> None:
    """By MasterAlive alone, where the loop of the node hangs that would have ended the step."""
    with NodeBench(lamp_limit_ms=1000) as bench:
        bench.ready()
        bench.raw(bench.routine(CURE_ROUTINE, 1, 0, option=(900).to_bytes(2, "big")), CURE)
        bench.tick()
        for passed in (200, 200, 200, 200, 199):
            bench.clock += passed
            bench.send_keep_alive()
        assert bench.state(CURE).state == "CURING"
        bench.clock += 1
        bench.send_keep_alive()
        assert (bench.state(CURE).state, bench.state(CURE).cause) == ("FAULT", LAMP_TIME)
        assert bench.times(CURE).lamp_off == bench.clock


def test_journal_that_fails_in_a_fault_is_the_fault_that_is_reported(bench: NodeBench) -> None:
    """A record that the node cannot write outlasts its fault."""
    begin_pass(bench)
    bench.tear(5)
    bench.broken(GATE_STAYS_CLOSED)
    assert off_after(bench, HEAD) == ("FAULT", JOURNAL_DAMAGED)


def test_pattern_is_sent_again_after_whatever_ended_a_layer(bench: NodeBench) -> None:
    begin_pass(bench)
    bench.stop(True)
    bench.stop(False)
    assert bench.clear(option=1) == DONE
    assert not bench.state().pattern_loaded
    assert bench.run(PASS, layer=1, option=b"\x00") == -NRC_SEQUENCE


def test_cure_whose_lamp_stays_dark_is_not_done_and_is_repeated(bench: NodeBench) -> None:
    bench.broken(LAMP_STAYS_OFF)
    assert bench.cure(1) == -NRC_FAILED
    state = bench.state(CURE)
    assert (state.state, state.cause, state.needs_operator, state.cured) == ("FAULT", LAMP_TIME, True, 0)
    bench.broken(0)
    assert bench.clear(CURE, 1) == DONE
    assert bench.cure(1) == DONE
    assert bench.state(CURE).cured == 1


def test_gate_that_does_not_open_ends_the_pass_before_a_droplet(bench: NodeBench) -> None:
    bench.broken(GATE_STAYS_CLOSED)
    assert bench.run(PASS, layer=1, option=b"\x00") == -NRC_FAILED
    assert (bench.state().state, bench.state().cause) == ("FAULT", GATE_NOT_CONFIRMED)
    assert not bench.surface.any()


def test_gate_that_does_not_close_is_a_fault_but_the_pass_is_done(bench: NodeBench) -> None:
    begin_pass(bench)
    bench.tick(LONG - 300)
    bench.broken(GATE_STAYS_OPEN)
    bench.tick(2000)
    assert (bench.state().state, bench.state().cause) == ("FAULT", GATE_NOT_CONFIRMED)
    assert (bench.state().done, bench.state().unknown) == (1, 0)


def test_device_that_hangs_is_a_fault(bench: NodeBench) -> None:
    bench.broken(WORK_HANGS)
    assert bench.run(HOME, STAGE, attempt=2) == -NRC_FAILED
    assert (bench.state(STAGE).state, bench.state(STAGE).cause) == ("FAULT", STEP_EXPIRED)


FAILING = [
    (HOME, b"", STAGE, STAGE_POSITION),
    (MOVE, b"\1", STAGE, STAGE_POSITION),
    (PURGE, b"", HEAD, BACK_PRESSURE),
    (PASS, b"\0", HEAD, BACK_PRESSURE),
    (SCAN, b"", PROFILER, SCAN_FAILED),
]


@pytest.mark.parametrize(("routine", "option", "node", "cause"), FAILING)
def test_device_that_fails_is_a_fault_that_names_it(
    bench: NodeBench, routine: int, option: bytes, node: int, cause: int
) -> None:
    bench.broken(WORK_FAILS)
    assert bench.run(routine, node, layer=1, attempt=2, option=option) == -NRC_FAILED
    assert (bench.state(node).state, bench.state(node).cause) == ("FAULT", cause)


@pytest.mark.parametrize(("routine", "option", "node", "cause"), FAILING)
def test_device_that_cannot_begin_is_a_fault_and_the_request_is_refused_once(
    bench: NodeBench, routine: int, option: bytes, node: int, cause: int
) -> None:
    bench.refuse_work(node)
    answers = [bench.raw(bench.routine(routine, 1, attempt=2, option=option), node)]
    bench.tick(100)
    answers += [bench.late(node), bench.late(node)]
    assert answers == [b"\x7f\x31\x78", bytes((0x7F, 0x31, NRC_FAILED)), b""]
    assert (bench.state(node).state, bench.state(node).cause) == ("FAULT", cause)


@pytest.mark.parametrize(("routine", "option"), [(HOME, b""), (MOVE, b"\1")])
def test_stage_needs_motion_all_the_way(routine: int, option: bytes) -> None:
    with NodeBench(home_ms=LONG, move_ms=LONG) as bench:
        assert bench.ready().raw(bench.routine(routine, attempt=2, option=option), STAGE)[2] == NRC_PENDING
        bench.tick(200)
        assert not bench.late(STAGE)
        bench.master = MasterAlive(LAMP | GATE, 1, 7)
        assert off_after(bench, STAGE) == ("SAFE", ENABLE_DROPPED)


@pytest.mark.parametrize("broken", [0, WORK_HANGS], ids=["cut off", "hung"])
def test_stage_whose_homing_was_given_up_is_not_homed(broken: int) -> None:
    with NodeBench(home_ms=100 if broken else LONG) as bench:
        bench.tick(100)
        assert bench.clear(STAGE) == DONE
        bench.broken(broken)
        assert bench.raw(bench.routine(HOME), STAGE)[2] == NRC_PENDING
        bench.tick(200)
        bench.stop(True)
        bench.stop(False)
        bench.broken(0)
        assert bench.clear(STAGE, 1) == DONE
        assert bench.run(MOVE, STAGE, option=b"\1") == -NRC_CONDITIONS


def test_fault_stays_whatever_happens_after_it(bench: NodeBench) -> None:
    """A stop request that is released must not make a broken gate look like one that was stopped."""
    begin_cure(bench)
    bench.broken(GATE_STAYS_OPEN)
    bench.tick()
    fault = ("FAULT", GATE_NOT_CONFIRMED)
    bench.stop(True)
    assert (bench.state(CURE).state, bench.state(CURE).cause) == fault
    bench.stop(False)
    bench.send_keep_alive(MasterAlive(LAMP | GATE | MOTION, 2, 7))
    bench.c.node_supervision(bench.node(CURE), bench.clock, False)
    assert (bench.state(CURE).state, bench.state(CURE).cause) == fault


def test_first_cause_of_a_safe_node_is_the_one_that_is_reported(bench: NodeBench) -> None:
    bench.stop(True)
    bench.c.node_supervision(bench.node(CURE), bench.clock, False)
    assert bench.state(CURE).cause == STOP_REQUEST


def test_transfer_that_ended_before_a_stop_is_not_confirmed_after_it(bench: NodeBench) -> None:
    """The pattern is gone; an exit that is repeated must not say that it is there."""
    blob = pattern_blob(FULL)
    repeated = b"\x37" + zlib.crc32(blob).to_bytes(4, "big")
    assert bench.raw(repeated)[0] == 0x77
    bench.stop(True)
    bench.stop(False)
    assert bench.clear(HEAD, 1) == DONE
    assert bench.raw(repeated) == bytes((0x7F, 0x37, NRC_SEQUENCE))


def test_dry_run_that_is_stopped_leaves_no_layer_behind() -> None:
    with NodeBench(pass_ms=LONG) as bench:
        bench.ready()
        assert bench.run(DRY_RUN, option=b"\1") == DONE
        assert bench.download(pattern_blob(FULL), 1) == 0
        begin_pass(bench)
        bench.stop(True)
        bench.stop(False)
        state = bench.state()
        assert (state.layer, state.passes, state.done, state.unknown, state.pattern_crc) == (0, 0, 0, 0, 0)
        assert bench.clear(option=1) == DONE
        assert bench.download(pattern_blob(FULL), 1) == 0, "layer 1 comes first"
        assert bench.run(PASS, layer=1, option=b"\0") == DONE
        assert bench.counted(GATE_OPENINGS) == 1, "it is no dry run any more"


def test_new_session_between_two_ticks_takes_over_no_step(bench: NodeBench) -> None:
    """The old master is silent for its limit, and no tick has seen it yet."""
    begin_cure(bench)
    bench.clock = bench.last_alive + ALIVE
    bench.send_keep_alive(MasterAlive(LAMP | GATE | MOTION, 2, 7))
    assert (bench.state(CURE).state, bench.state(CURE).cause) == ("SAFE", MASTER_LOST)
    assert bench.times(CURE).lamp_off == bench.clock


def test_one_cure_cures_all_that_lies_there_where_head_and_lamp_are_one_node() -> None:
    with NodeBench(one_node=1) as bench:
        assert bench.ready().download(pattern_blob(FULL), 1) == 0
        for number in (0, 1):
            assert bench.run(PASS, layer=1, which=number, option=bytes([number])) == DONE
        assert bench.cure(1, 1) == DONE
        assert bench.state().cured == 0b11


@pytest.mark.parametrize(
    ("step", "node"),
    [
        (lambda bench: bench.run(HOME, STAGE, attempt=2), STAGE),
        (lambda bench: bench.run(PASS, layer=1, option=b"\x00"), HEAD),
        (lambda bench: bench.scan(0, attempt=2), PROFILER),
    ],
    ids=["home", "pass", "scan"],
)
def test_result_that_cannot_be_kept_is_a_fault_of_its_own(
    step: Callable[[NodeBench], int], node: int, bench: NodeBench
) -> None:
    bench.broken(STORAGE_FULL)
    assert step(bench) == -NRC_FAILED
    assert (bench.state(node).state, bench.state(node).cause) == ("FAULT", STORAGE_FAILED)
    assert bench.state(HEAD).unknown == (node == HEAD), "a pass whose trace is lost counts as unknown"
    bench.broken(0)
    assert bench.clear(node, 1) == DONE


def test_pass_may_take_its_limit_and_the_ways_of_the_gate_in_addition() -> None:
    with NodeBench(pass_ms=119_900, gate_ms=400) as bench:
        assert bench.ready().download(pattern_blob(FULL), 1) == 0
        assert bench.raw(bench.routine(PASS, 1, 0, option=b"\x00"))[2] == NRC_PENDING
        bench.tick(121_000, step=25)
        assert (bench.state().state, bench.state().done) == ("PRINTED", 1)


def test_scan_may_take_its_limit_and_no_longer() -> None:
    for scan_ms, expected in ((59_900, ("MAP_READY", 0)), (60_100, ("FAULT", STEP_EXPIRED))):
        with NodeBench(scan_ms=scan_ms) as bench:
            assert bench.ready().raw(bench.routine(SCAN), PROFILER)[2] == NRC_PENDING
            bench.tick(60_200, step=25)
            assert (bench.state(PROFILER).state, bench.state(PROFILER).cause) == expected


def test_node_says_that_it_is_still_busy_now_and_then() -> None:
    with NodeBench(scan_ms=20_000) as bench:
        assert bench.ready().raw(bench.routine(SCAN), PROFILER)[2] == NRC_PENDING
        said = []
        for _ in range(100):
            bench.tick(100, step=25)
            said.append(bench.late(PROFILER)[2:] == bytes([NRC_PENDING]))
        assert 3 <= sum(said) <= 10


def test_answer_that_was_not_fetched_is_not_that_of_the_next_step(bench: NodeBench) -> None:
    assert bench.raw(bench.routine(HOME, attempt=2), STAGE)[2] == NRC_PENDING
    bench.tick(100)
    assert bench.state(STAGE).step == 0
    assert bench.raw(bench.routine(MOVE, attempt=2, option=b"\1"), STAGE)[2] == NRC_PENDING
    assert bench.late(STAGE) == b""
    bench.tick(100)
    assert bench.late(STAGE)[2:4] == MOVE.to_bytes(2, "big")


def test_head_that_is_not_ready_does_not_begin(bench: NodeBench) -> None:
    bench.broken(NOT_READY)
    assert bench.run(PASS, layer=1, option=b"\x00") == -NRC_CONDITIONS
    assert bench.state().state == "VERIFIED"


def test_two_masters_make_every_node_safe_until_one_is_silent(bench: NodeBench) -> None:
    begin_cure(bench)
    bench.send_keep_alive(MasterAlive(LAMP | GATE | MOTION, 2, 7))
    assert {(bench.state(node).state, bench.state(node).cause) for node in range(4)} == {("SAFE", TWO_MASTERS)}
    assert bench.times(CURE).lamp_off == bench.clock
    assert bench.clear(CURE, 1) == -NRC_CONDITIONS
    bench.tick(400)
    assert bench.clear(CURE, 1) == DONE


@pytest.mark.parametrize(("third", "outcome"), [(False, DONE), (True, -NRC_CONDITIONS)])
def test_second_master_that_is_adopted_is_the_only_one_unless_there_is_a_third(
    bench: NodeBench, third: bool, outcome: int
) -> None:
    bench.master = MasterAlive(LAMP | GATE | MOTION, 2, 7)
    bench.send_keep_alive()
    assert bench.state(CURE).cause == TWO_MASTERS
    for _ in range(4):
        bench.tick(100)
        if third:
            bench.send_keep_alive(MasterAlive(LAMP | GATE | MOTION, 3, 7))
    assert bench.state(CURE).session == 2, "the first one is silent"
    assert bench.clear(CURE, 1) == outcome


def test_new_session_is_taken_up_after_the_old_one_is_silent(bench: NodeBench) -> None:
    bench.master = None
    bench.tick(400)
    bench.master = MasterAlive(LAMP | GATE | MOTION, 2, 7)
    bench.tick(100)
    assert bench.clear(CURE) == DONE
    assert bench.state(CURE).session == 2


def test_supervision_that_fails_makes_a_node_safe(bench: NodeBench) -> None:
    begin_cure(bench)
    bench.c.node_supervision(bench.node(CURE), bench.clock, False)
    assert (bench.state(CURE).state, bench.state(CURE).cause) == ("SAFE", SUPERVISION)
    assert bench.clear(CURE, 1) == -NRC_CONDITIONS
    bench.c.node_supervision(bench.node(CURE), bench.clock, True)
    assert bench.clear(CURE, 1) == DONE


WRAP = 1 << 32
"""Milliseconds after which the clock of a node shows the same number again: 49.7 days."""


@pytest.fixture
def unwatched() -> Iterator[NodeBench]:
    """The clock may jump: no watchdog waits for the ticks in between."""
    with NodeBench(watchdog_ms=0) as made:
        yield made.ready()


def test_master_that_fell_silent_is_not_alive_when_the_clock_shows_the_same_number_again(unwatched: NodeBench) -> None:
    bench = unwatched
    bench.master = None
    silent_since = bench.last_alive
    bench.tick(400)
    for passed in range(0, 300, 50):
        bench.clock = silent_since + WRAP + passed
        bench.tick()
        assert bench.clear(STAGE) == -NRC_CONDITIONS
        assert bench.run(HOME, STAGE, attempt=2) == -NRC_CONDITIONS
    assert bench.state(STAGE).state == "SAFE"


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


CONTRADICTION = GATE_STAYS_OPEN | GATE_STAYS_CLOSED
"""Both end switches of the gate are true: one of them is wrong, and which one is not known."""


def test_end_switches_that_contradict_each_other_refuse_whatever_needs_the_gate(bench: NodeBench) -> None:
    bench.broken(CONTRADICTION)
    assert bench.run(PASS, layer=1, option=b"\x00") == -NRC_CONDITIONS
    assert bench.cure(1) == -NRC_CONDITIONS
    assert bench.run(SELF_TEST, HEAD, option=b"\0\0") == bench.run(SELF_TEST, CURE, option=b"\0\x64") == -NRC_CONDITIONS
    assert bench.counted(GATE_OPENINGS) == bench.counted(LAMP_PULSES) == 0
    assert bench.state().state == "VERIFIED", "the pass was not begun: it is not unknown"


@pytest.mark.parametrize(("node", "begin"), [(HEAD, begin_pass), (CURE, begin_cure)])
def test_end_switches_that_begin_to_contradict_each_other_end_the_step(bench: NodeBench, node: int, begin) -> None:
    begin(bench)
    bench.broken(CONTRADICTION)
    seen = bench.clock + 5
    bench.tick()
    assert (bench.state(node).state, bench.state(node).cause) == ("FAULT", GATE_NOT_CONFIRMED)
    assert (bench.times(node).gate_closed if node == HEAD else bench.times(node).lamp_off) == seen


def test_end_switches_that_contradict_each_other_while_the_gate_opens_let_no_droplet_out(bench: NodeBench) -> None:
    assert bench.raw(bench.routine(PASS, 1, 0, option=b"\x00")) == b"\x7f\x31\x78"
    bench.broken(CONTRADICTION)
    bench.tick(LONG)
    assert (bench.state().state, bench.state().cause, bench.state().unknown) == ("FAULT", GATE_NOT_CONFIRMED, 1)
    assert not bench.surface.any()


def test_end_switches_that_contradict_each_other_leave_a_finished_pass_done(bench: NodeBench) -> None:
    begin_pass(bench)
    while bench.state().state == "PRINTING" and not bench.state().done:
        bench.tick()
    bench.broken(CONTRADICTION)
    bench.tick(LONG)
    assert (bench.state().state, bench.state().cause) == ("FAULT", GATE_NOT_CONFIRMED)
    assert (bench.state().done, bench.state().unknown) == (1, 0)


def test_pass_needs_motion_where_head_and_stage_are_one_node() -> None:
    with NodeBench(one_node=1, pass_ms=LONG) as bench:
        bench.ready()
        bench.master = MasterAlive(LAMP | GATE, 1, 7)
        bench.tick(100)
        assert bench.run(SCAN, layer=0) == -NRC_CONDITIONS
        assert bench.download(pattern_blob(FULL), 1) == 0
        assert bench.run(PASS, layer=1, option=b"\x00") == -NRC_CONDITIONS
        assert bench.state().unknown == bench.counted(GATE_OPENINGS) == 0
        bench.master = MasterAlive(GATE | MOTION, 1, 7)
        bench.tick(100)
        begin_pass(bench)
        bench.master = MasterAlive(GATE, 1, 7)
        assert off_after(bench, HEAD) == ("SAFE", ENABLE_DROPPED)
        assert bench.state().unknown == 1


@pytest.mark.parametrize(("one_node", "expected"), [(0, ("SCANNING", 0)), (1, ("SAFE", ENABLE_DROPPED))])
def test_scan_needs_motion_all_the_time_where_profiler_and_stage_are_one_node(one_node: int, expected: Any) -> None:
    node = HEAD if one_node else PROFILER
    with NodeBench(one_node=one_node, scan_ms=LONG) as bench:
        assert bench.ready().raw(bench.routine(SCAN), node)[2] == NRC_PENDING
        bench.tick(200)
        bench.master = MasterAlive(LAMP | GATE, 1, 7)
        bench.tick(500)
        assert (bench.state(node).state, bench.state(node).cause) == expected


@pytest.mark.parametrize("one_node", [0, 1])
def test_dry_run_needs_motion_alone(one_node: int) -> None:
    """Neither lamp nor gate is switched; a stage moves."""
    head, cure = (HEAD, HEAD) if one_node else (HEAD, CURE)
    with NodeBench(one_node=one_node, pass_ms=LONG) as bench:
        bench.ready()
        for node in {head, cure}:
            assert bench.run(DRY_RUN, node, option=b"\1") == DONE
        bench.master = MasterAlive(MOTION, 1, 7)
        bench.tick(100)
        assert bench.download(pattern_blob(FULL, passes=1), 1) == 0
        assert bench.raw(bench.routine(PASS, 1, option=b"\xff")) == b"\x7f\x31\x78"
        bench.tick(LONG + 100)
        assert bench.late()[4] == DONE
        assert bench.raw(bench.routine(CURE_ROUTINE, 1, option=b"\x01\xf4"), cure) == b"\x7f\x31\x78"
        bench.tick(1000)
        assert bench.late(cure)[4] == DONE
        assert bench.counted(GATE_OPENINGS) == bench.counted(LAMP_PULSES) == 0


@pytest.mark.parametrize(
    ("node", "milliseconds", "own", "others"), [(HEAD, 0, GATE, LAMP | MOTION), (CURE, LONG, LAMP, GATE | MOTION)]
)
def test_self_test_needs_the_enable_of_what_it_switches(node: int, milliseconds: int, own: int, others: int) -> None:
    with NodeBench(gate_ms=300) as bench:
        bench.ready()
        request = bench.routine(SELF_TEST, option=milliseconds.to_bytes(2, "big"))
        bench.master = MasterAlive(others, 1, 7)
        bench.tick(100)
        assert bench.raw(request, node)[:3] == bytes((0x7F, 0x31, NRC_CONDITIONS))
        bench.master = MasterAlive(own, 1, 7)
        bench.tick(100)
        assert bench.raw(request, node) == b"\x7f\x31\x78"
        bench.tick(200)
        assert bench.state(node).state == "IDLE"
        bench.master = MasterAlive(others, 1, 7)
        assert off_after(bench, node) == ("SAFE", ENABLE_DROPPED)


def test_lamp_node_that_switches_off_closes_the_gate_as_well(bench: NodeBench) -> None:
    begin_pass(bench)
    bench.c.node_supervision(bench.node(CURE), bench.clock, False)
    bench.tick()
    assert (bench.state().state, bench.state().cause) == ("FAULT", GATE_NOT_CONFIRMED)
    assert bench.state(CURE).state == "SAFE"


def test_second_master_asks_for_a_person(bench: NodeBench) -> None:
    bench.send_keep_alive(MasterAlive(LAMP | GATE | MOTION, 2, 7))
    bench.tick(400)
    assert bench.clear(CURE) == -NRC_CONDITIONS
    assert bench.clear(CURE, 1) == DONE


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
    assert bench.clear(HEAD, 1) == -NRC_FAILED
    assert (bench.state().state, bench.state().cause) == ("FAULT", JOURNAL_DAMAGED)
    assert bench.times().off == bench.clock


def test_map_of_a_node_that_went_safe_is_scanned_again(bench: NodeBench) -> None:
    assert bench.scan(0) == DONE
    bench.stop(True)
    bench.stop(False)
    assert bench.clear(PROFILER, 1) == DONE
    assert bench.raw(b"\x22\x01\x00", PROFILER)[6] & 16 == 0
    assert bench.raw(bench.routine(SCAN, kind=3), PROFILER)[4] == 4, "never"
    assert bench.raw(b"\x22\x01\x03", PROFILER)[3:7] == bytes(4)
