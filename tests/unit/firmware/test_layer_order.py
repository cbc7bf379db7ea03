"""Invariants of the layer cycle of the bench's nodes: order of the steps, and nothing happens twice."""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
import pytest

from inkloop_hardware.protocol.services import Routine
from support.benches.node_bench import (
    CURE,
    CURE_ROLE,
    DONE,
    DONE_BEFORE,
    HEAD,
    HEAD_ROLE,
    NEVER,
    PROFILER,
    STAGE,
    STAGE_ROLE,
    STATES,
    UNDER_WAY,
    Broken,
    NodeBench,
    Nrc,
    pattern_blob,
)

FULL = np.ones((9, 8), np.uint8)
SPARSE = np.eye(9, 8, dtype=np.uint8)


@pytest.fixture(params=[0, 1], ids=["four nodes", "one node"])
def bench(request: pytest.FixtureRequest) -> Any:
    with NodeBench(one_node=request.param) as made:
        yield made


def everything(bench: NodeBench) -> Any:
    """State that must not change when a request is refused or repeated."""
    states = [bench.state(node) for node in range(bench.count)]
    journals = [bench.journal(node) for node in range(bench.count)]
    return states, journals, bench.surface.copy().tobytes(), bench.gate_openings, bench.lamp_pulses


def test_three_layers_go_round(bench: NodeBench) -> None:
    bench.ready()
    for layer in (1, 2, 3):
        bench.print_layer(FULL, layer)
        assert bench.scan(layer) == DONE
    assert bench.gate_openings == bench.lamp_pulses == 12
    assert bench.lamp_with_gate == 0
    assert bench.state().done == 15


def test_states_are_passed_in_order() -> None:
    with NodeBench(one_node=1) as bench:
        seen = [bench.state().state]
        for request in (
            bench.routine(Routine.CLEAR, option=b"\0"),
            bench.routine(Routine.HOME),
            bytes.fromhex("34 00 44 00000001 00000010"),
            None,
            bench.routine(Routine.PASS, 1, option=b"\xff"),
            bench.routine(Routine.CURE, 1, option=b"\x00\x14"),
            bench.routine(Routine.SCAN, 1),
        ):
            bench.tick(100)
            if request is None:
                assert bench.download(pattern_blob(FULL, passes=1), 1) == 0
            else:
                bench.raw(request)
            for _ in range(30):
                if bench.state().state != seen[-1]:
                    seen.append(bench.state().state)
                bench.tick()
        assert tuple(seen) == STATES[:-1]


def test_nothing_is_done_before_the_node_is_cleared(bench: NodeBench) -> None:
    bench.tick(100)
    before = everything(bench)
    stage, cure, profiler = (STAGE, CURE, PROFILER) if bench.count == 4 else (HEAD, HEAD, HEAD)
    assert bench.download(pattern_blob(FULL), 1) == -Nrc.CONDITIONS
    assert bench.run(Routine.HOME, stage) == bench.run(Routine.MOVE, stage, option=b"\x01") == -Nrc.CONDITIONS
    assert bench.run(Routine.PURGE) == bench.jet(1) == -Nrc.CONDITIONS
    assert bench.cure(1) == bench.scan(1) == -Nrc.CONDITIONS
    assert (
        bench.run(Routine.DRY_RUN, profiler, option=b"\x01")
        == bench.run(Routine.DRY_RUN, cure, option=b"\x01")
        == -Nrc.CONDITIONS
    )
    assert everything(bench) == before


def test_repeat_of_done_changes_nothing(bench: NodeBench) -> None:
    bench.ready().print_layer(SPARSE, 1)
    assert bench.scan(1) == DONE
    before = everything(bench)
    for number in range(4):
        assert bench.run(Routine.PASS, layer=1, which=number, attempt=9, option=bytes([number])) == DONE_BEFORE
        assert bench.cure(1, number, attempt=9) == DONE_BEFORE
    assert bench.scan(1) == DONE_BEFORE
    assert bench.run(Routine.HOME, STAGE if bench.count == 4 else HEAD) == DONE_BEFORE
    assert everything(bench) == before


def test_repeat_of_what_is_under_way_does_not_begin_it_again(bench: NodeBench) -> None:
    bench.ready()
    assert bench.download(pattern_blob(SPARSE), 1) == 0
    request = bench.routine(Routine.PASS, 1, 0, option=b"\x00")
    assert bench.raw(request) == bench.raw(request) == b"\x7f\x31\x78"
    assert bench.raw(bench.routine(Routine.PASS, 1, 0, kind=3))[4] == UNDER_WAY
    assert bench.raw(bench.routine(Routine.PASS, 1, 1, option=b"\x01")) == b"\x7f\x31\x21"
    bench.tick(200)
    assert bench.late()[4] == DONE
    assert bench.late() == b""
    assert bench.gate_openings == 1


@pytest.mark.parametrize("number", [1, 2, 3])
def test_passes_come_in_their_order(bench: NodeBench, number: int) -> None:
    bench.ready()
    assert bench.download(pattern_blob(SPARSE), 1) == 0
    before = everything(bench)
    assert bench.jet(1, number, 0) == -Nrc.SEQUENCE
    assert bench.jet(1, 4, 0) == -Nrc.RANGE
    assert bench.jet(1, colour=4) == -Nrc.RANGE
    assert bench.jet(1, colour=255) == -Nrc.RANGE
    assert bench.jet(2) == -Nrc.SEQUENCE
    assert bench.run(Routine.PASS, layer=1, which=0, option=b"\x00", job=8) == -Nrc.SEQUENCE
    assert bench.raw(bench.routine(Routine.PASS, 1, number, kind=3))[4] == NEVER
    assert everything(bench) == before


@pytest.mark.parametrize(
    ("printed", "refused"), [("nothing", (0,)), ("pattern", (0, 2)), ("pass", (0, 1, 2, 3)), ("layer", (0, 1, 3))]
)
def test_layers_come_in_their_order_and_none_twice(bench: NodeBench, printed: str, refused: tuple[int, ...]) -> None:
    bench.ready()
    if printed == "layer":
        bench.print_layer(FULL, 1)
        assert bench.scan(1) == DONE
    elif printed != "nothing":
        assert bench.download(pattern_blob(SPARSE), 1) == bench.download(pattern_blob(FULL), 1) == 0
        assert bench.clear() == DONE, (
            "every device of a rig clears the nodes: of one that is not off it changes nothing"
        )
        assert bench.state().state == "VERIFIED"
    if printed == "pass":
        assert bench.jet(1) == DONE
    before = everything(bench)
    for layer in refused:
        assert bench.download(pattern_blob(SPARSE), layer) == -Nrc.SEQUENCE
    assert bench.jet(2) == -Nrc.SEQUENCE
    assert bench.cure(1, 4) == bench.cure(1, 255) == -Nrc.RANGE
    assert everything(bench) == before


@pytest.mark.parametrize("ended", ["printed", "abandoned", "cure interrupted", "pass interrupted", "no profiler"])
def test_wet_ink_is_cured_and_seen_before_anything_else_by_a_node_that_knows(ended: str) -> None:
    with NodeBench(one_node=1, pass_ms=100) as bench:
        bench.ready()
        if ended == "no profiler":
            bench.roles(HEAD_ROLE | STAGE_ROLE | CURE_ROLE)
        assert bench.download(pattern_blob(FULL, passes=1), 1) == 0
        assert bench.cure(1) == -Nrc.SEQUENCE, "nothing to cure"
        if ended == "pass interrupted":
            bench.raw(bench.routine(Routine.PASS, 1, option=b"\xff"))
            bench.tick(50)
        else:
            assert bench.jet(1, colour=255) == DONE
        if ended == "cure interrupted":
            assert bench.raw(bench.routine(Routine.CURE, 1, option=b"\0\xff")) == b"\x7f\x31\x78"
            bench.tick()
        if "interrupted" in ended:
            bench.power_up()
            bench.tick(100)
        if ended not in ("printed", "no profiler"):
            assert bench.clear(HEAD, 3 if ended == "abandoned" else 1) == DONE
        assert bench.download(pattern_blob(FULL), 2) == -Nrc.SEQUENCE
        if ended != "no profiler":
            assert bench.scan(1) == -Nrc.SEQUENCE
        assert bench.cure(1, attempt=2) == DONE
        if ended != "no profiler":
            assert bench.download(pattern_blob(FULL), 2) == -Nrc.SEQUENCE, "not seen yet"
            assert bench.scan(1) == DONE
        assert bench.download(pattern_blob(FULL), 2) == 0


def test_rescan_is_allowed_and_a_stale_map_is_not_given(bench: NodeBench) -> None:
    profiler = PROFILER if bench.count == 4 else HEAD
    bench.ready()
    assert bench.scan(0) == DONE, "the start surface"
    bench.print_layer(FULL, 1)
    assert bench.scan(1) == DONE
    first = bench.upload(1, profiler)
    bench.surface[0, 0] += 5e-6
    assert bench.scan(1, attempt=1) == DONE_BEFORE
    assert bench.upload(1, profiler) == first
    assert bench.scan(1, attempt=2) == DONE
    assert bench.upload(1, profiler) != first
    assert bench.scan(0) == -Nrc.SEQUENCE


def test_scan_of_another_attempt_waits_until_this_one_is_over(bench: NodeBench) -> None:
    profiler = PROFILER if bench.count == 4 else HEAD
    bench.ready()
    assert bench.raw(bench.routine(Routine.SCAN, attempt=1), profiler)[2] == Nrc.PENDING
    assert bench.raw(bench.routine(Routine.SCAN, attempt=2), profiler)[2] == Nrc.BUSY
    assert bench.raw(bench.routine(Routine.SCAN, attempt=1), profiler)[2] == Nrc.PENDING
    bench.tick(8000)
    assert bench.scan(0, attempt=1) == DONE_BEFORE
    assert bench.raw(bench.routine(Routine.SCAN, attempt=2), profiler)[2] == Nrc.PENDING
    assert bench.raw(bench.routine(Routine.SCAN, attempt=1), profiler)[2] == Nrc.BUSY, "its map is being overwritten"
    bench.tick(8000)
    assert bench.scan(0, attempt=2) == DONE_BEFORE
    assert bench.run(Routine.SCAN, profiler, which=4) == -Nrc.RANGE, "what could not be known as done before"


def test_service_of_another_role_is_refused() -> None:
    with NodeBench() as bench:
        bench.ready()
        for node in range(4):
            own = {HEAD: Routine.PASS, STAGE: Routine.HOME, CURE: Routine.CURE, PROFILER: Routine.SCAN}
            for other, routine in own.items():
                if other != node:
                    assert bench.raw(bench.routine(routine, 1), node) == b"\x7f\x31\x31"
            if node != HEAD:
                assert bench.raw(bytes.fromhex("3400440000000100000010"), node) == b"\x7f\x34\x11"
            if node != PROFILER:
                assert bench.raw(bytes.fromhex("3500440000000100000010"), node) == b"\x7f\x35\x11"


def test_dry_run_prints_lights_and_remembers_nothing(bench: NodeBench) -> None:
    bench.ready().print_layer(SPARSE, 1)
    assert bench.scan(1) == DONE
    surface, journals = bench.surface.copy(), [bench.journal(node) for node in range(bench.count)]
    openings, pulses = bench.gate_openings, bench.lamp_pulses
    bench.stop(True), bench.stop(False)
    for node in range(bench.count):
        assert bench.clear(node, 1) == DONE
        assert bench.run(Routine.DRY_RUN, node, option=b"\x01") == DONE
    if bench.count == 1:
        assert bench.scan(1) == DONE
    bench.print_layer(FULL, 2)
    for node in range(bench.count):
        assert bench.run(Routine.DRY_RUN, node, option=b"\x00") == DONE
    assert bench.state().layer == 1
    assert bench.surface.tobytes() == surface.tobytes()
    assert (bench.gate_openings, bench.lamp_pulses) == (openings, pulses)
    cleared: list[tuple[int, ...]] = [(6, 0, 0)]
    assert [bench.journal(node) for node in range(bench.count)] == [journal + cleared for journal in journals]


def test_another_job_begins_when_the_last_one_is_over(bench: NodeBench) -> None:
    assert bench.master
    bench.ready()
    assert bench.download(pattern_blob(SPARSE), 1) == 0
    assert bench.jet(1) == DONE
    bench.master.job = 8
    bench.send_keep_alive()
    assert bench.download(pattern_blob(FULL), 1) == -Nrc.SEQUENCE
    assert bench.clear(HEAD, 2) == -Nrc.CONDITIONS, "only a person gives a layer up"
    assert bench.clear(HEAD, 3) == DONE
    if bench.count == 1:
        assert bench.cure(1) == bench.scan(1) == DONE
    assert bench.download(pattern_blob(FULL), 1) == 0
    assert (bench.state().job, bench.state().done) == (8, 0)


def test_nodes_without_a_pattern_begin_another_job_at_its_first_layer() -> None:
    with NodeBench() as bench:
        bench.ready()
        for layer in (1, 5):
            assert bench.cure(layer) == bench.scan(layer) == DONE
        assert bench.cure(4) == bench.scan(4) == -Nrc.SEQUENCE
        assert bench.run(Routine.CURE, CURE, layer=1, option=b"\0\x14", job=8) == DONE
        assert bench.run(Routine.SCAN, PROFILER, layer=0, job=8) == DONE
        assert (bench.state(CURE).job, bench.state(CURE).layer) == (8, 1)


def test_dry_run_begins_where_nothing_is_under_way_and_leaves_nothing(bench: NodeBench) -> None:
    blob = pattern_blob(FULL)
    exit_ = b"\x37" + zlib.crc32(blob).to_bytes(4, "big")
    assert bench.ready().download(blob, 1) == 0
    assert bench.run(Routine.DRY_RUN, option=b"\1") == -Nrc.SEQUENCE
    assert bench.run(Routine.DRY_RUN, attempt=2, option=b"\0") == DONE, "there is none"
    assert bench.state().pattern_loaded
    assert bench.run(Routine.DRY_RUN, attempt=3, option=b"\2") == -Nrc.RANGE
    bench.stop(True), bench.stop(False)
    assert bench.clear(option=1) == DONE
    assert bench.run(Routine.DRY_RUN, option=b"\1") == DONE
    assert bench.run(Routine.SELF_TEST, option=b"\0\0") == -Nrc.CONDITIONS
    assert bench.download(blob, 1) == 0
    assert bench.raw(exit_)[0] == 0x77
    assert bench.run(Routine.DRY_RUN, attempt=2, option=b"\0") == DONE
    assert (bench.state().state, bench.state().pattern_loaded) == ("IDLE", False)
    assert bench.raw(exit_) == bytes((0x7F, 0x37, Nrc.SEQUENCE))
    assert bench.run(Routine.DRY_RUN, attempt=3, option=b"\1") == DONE
    assert bench.raw(bytes.fromhex("3400440000000100000010"))[0] == 0x74
    assert bench.run(Routine.DRY_RUN, attempt=4, option=b"\0") == DONE
    assert bench.raw(b"\x36\x01\x01") == bytes((0x7F, 0x36, Nrc.SEQUENCE))


def test_stage_knows_its_stations_and_moves_to_none_before_it_is_homed(bench: NodeBench) -> None:
    stage = STAGE if bench.count == 4 else HEAD
    bench.tick(100)
    assert [bench.clear(node) for node in range(bench.count)] == [DONE] * bench.count
    assert bench.run(Routine.MOVE, stage, option=b"\1") == -Nrc.CONDITIONS
    assert bench.scan(0) == (-Nrc.CONDITIONS if stage == HEAD else DONE), (
        "a profiler that is no stage need not be homed"
    )
    bench.broken(Broken.NOT_READY)
    assert bench.run(Routine.PURGE) == -Nrc.CONDITIONS
    bench.broken(0)
    assert bench.run(Routine.PURGE, attempt=2) == DONE
    assert bench.download(pattern_blob(FULL), 1) == 0
    if stage == HEAD:
        assert bench.jet(1) == -Nrc.CONDITIONS
    assert bench.run(Routine.HOME, stage) == DONE
    assert [bench.run(Routine.MOVE, stage, attempt=k, option=bytes([k])) for k in range(5)] == [*[DONE] * 4, -Nrc.RANGE]
    assert bench.jet(1) == DONE


def test_nothing_is_transferred_during_a_step(bench: NodeBench) -> None:
    """Nor is what was transferred before it confirmed again: the node answers one thing at a time."""
    blob = pattern_blob(FULL)
    assert bench.ready().download(blob, 1) == 0
    assert bench.raw(bench.routine(Routine.PASS, 1, 0, option=b"\0")) == b"\x7f\x31\x78"
    exit_ = b"\x37" + zlib.crc32(blob).to_bytes(4, "big")
    for request in (bytes.fromhex("34 00 44 00000001 0000001A"), b"\x36\x01\x00", exit_):
        assert bench.raw(request) == bytes((0x7F, request[0], Nrc.BUSY))
    bench.tick(100)
    assert bench.late()[4] == DONE
    assert bench.raw(exit_)[0] == 0x77
    assert bench.cure(1) == DONE
    assert bench.raw(exit_)[0] == 0x77


def test_routine_without_a_record_is_done_before_by_its_whole_key_alone(bench: NodeBench) -> None:
    stage = STAGE if bench.count == 4 else HEAD
    key: dict[str, Any] = {"job": 7, "layer": 3, "which": 2, "attempt": 5}
    assert bench.ready().run(Routine.HOME, stage, **key) == DONE
    for change in ({"job": 8}, {"layer": 2}, {"which": 1}, {"attempt": 6}):
        assert bench.raw(bench.routine(Routine.HOME, **(key | change), kind=3), stage)[4] == NEVER, change
    assert bench.raw(bench.routine(Routine.MOVE, **key, kind=3), stage)[4] == NEVER
    assert bench.raw(bench.routine(Routine.HOME, **key, kind=3), stage)[4] == DONE_BEFORE
    assert bench.run(Routine.HOME, stage, **key) == DONE_BEFORE


HOME, MOVE, PURGE, JET, SCAN = range(5)


def test_devices_get_station_colour_and_layer_of_their_step(bench: NodeBench) -> None:
    """Of other work they are 0."""
    stage, profiler = (STAGE, PROFILER) if bench.count == 4 else (HEAD, HEAD)
    bench.ready()
    assert bench.work(stage) == (HOME, 0, 0, 0, 0)
    assert bench.run(Routine.MOVE, stage, layer=4, option=b"\3") == DONE
    assert bench.work(stage) == (MOVE, 0, 0, 3, 4)
    assert bench.run(Routine.PURGE, layer=5) == DONE
    assert bench.work() == (PURGE, 0, 0, 0, 5)
    assert bench.download(pattern_blob(FULL), 1) == 0
    assert bench.jet(1, 0, 2) == DONE
    assert bench.work() == (JET, 0, 2, 0, 1)
    if bench.count == 4:
        assert bench.scan(7) == DONE
        assert bench.work(profiler) == (SCAN, 0, 0, 0, 7)
        assert bench.run(Routine.DRY_RUN, stage, option=b"\1") == DONE
        assert bench.run(Routine.MOVE, stage, layer=4, attempt=2, option=b"\2") == DONE
        assert bench.work(stage) == (MOVE, 1, 0, 2, 4)


def test_work_lasts_as_long_as_is_said_of_its_kind() -> None:
    with NodeBench(gate_ms=0, home_ms=200, move_ms=250, purge_ms=300, pass_ms=350, scan_ms=400) as bench:
        assert bench.ready().download(pattern_blob(FULL), 1) == 0
        for routine, node, option, milliseconds in (
            (Routine.HOME, STAGE, b"", 200),
            (Routine.MOVE, STAGE, b"\1", 250),
            (Routine.PURGE, HEAD, b"", 300),
            (Routine.PASS, HEAD, b"\0", 350),
            (Routine.SCAN, PROFILER, b"", 400),
        ):
            began = bench.clock
            assert bench.run(routine, node, layer=1, attempt=2, option=option) == DONE
            assert milliseconds < bench.clock - began <= milliseconds + 20
