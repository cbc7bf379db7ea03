"""Knowledge of a node after a power failure: every step is done, not begun, or reported as unknown."""

from __future__ import annotations

import ctypes
import zlib
from collections.abc import Iterator
from struct import pack, unpack_from

import numpy as np
import pytest

from inkloop_hardware.protocol.records import Fault
from inkloop_hardware.protocol.services import Routine
from support.benches.node_bench import (
    CURE,
    DONE,
    DONE_BEFORE,
    HEAD,
    NEVER,
    PROFILER,
    RASTER,
    UNKNOWN,
    NodeBench,
    Nrc,
    pattern_blob,
)

FULL = np.ones((9, 8), np.uint8)
RECORD = 40
INTENT, DONE_RECORD = 3, 4
SECTOR, SECTORS, IN_SECTOR = 4096, 4, 4096 // RECORD


@pytest.fixture
def bench() -> Iterator[NodeBench]:
    with NodeBench() as made:
        made.ready()
        assert made.download(pattern_blob(FULL), 1) == 0
        yield made


def reboot(bench: NodeBench, node: int = HEAD) -> None:
    bench.power_up(node)
    bench.tick(100)


def known(bench: NodeBench, number: int) -> int:
    """Outcome that the node reports of a pass, asked without starting it."""
    return bench.raw(bench.routine(Routine.PASS, 1, number, kind=3))[4]


@pytest.mark.parametrize("after", range(0, 400, 5))
def test_power_failure_at_any_time_doubles_and_hides_no_pass(after: int) -> None:
    """A layer of 4 passes of about 60 ms; the master resumes by what the node reports."""
    with NodeBench() as bench:
        bench.ready()
        pattern = pattern_blob(FULL)
        assert bench.download(pattern, 1) == 0
        begun, end = 0, bench.clock + after
        while bench.clock < end and begun < 4:
            bench.raw(bench.routine(Routine.PASS, 1, begun, option=bytes([begun])))
            bench.tick()
            begun += bench.late()[4:5] == bytes([DONE])
        opened = bench.gate_openings
        reboot(bench)
        state = bench.state()
        assert (state.done | state.unknown).bit_count() == opened
        assert state.needs_operator == bool(state.unknown)
        if state.unknown:
            number = state.unknown.bit_length() - 1
            assert state.cause == Fault.PASS_UNKNOWN
            assert known(bench, number) == UNKNOWN
            assert bench.clear() == -Nrc.CONDITIONS
            assert bench.clear(option=1) == DONE
            assert bench.download(pattern, 1) == -Nrc.SEQUENCE, "closed to jetting"
            assert bench.jet(1, number, 0) == -Nrc.SEQUENCE
            assert bench.download(pattern, 2) == 0
            return
        assert bench.clear() == DONE
        if state.done < 15:
            assert bench.download(pattern, 1) == 0
        for number in RASTER:
            expected = DONE_BEFORE if state.done >> number & 1 else DONE
            assert bench.jet(1, number) == expected
        assert bench.gate_openings == 4


def test_resumed_layer_takes_the_same_pattern_only(bench: NodeBench) -> None:
    assert bench.jet(1) == DONE
    reboot(bench)
    assert bench.clear() == DONE
    assert bench.jet(1, 1) == -Nrc.SEQUENCE, "the pattern is lost"
    assert bench.download(pattern_blob(np.eye(9, 8)), 1) == -0x72
    assert bench.download(pattern_blob(FULL), 1) == 0
    assert bench.state().state == "PRINTED"
    assert bench.jet(1, 1) == DONE


def stop(bench: NodeBench) -> None:
    bench.stop(True)
    bench.stop(False)


@pytest.mark.parametrize("written", [0, 1, 20, RECORD - 1])
@pytest.mark.parametrize("torn", ["INTENT", "DONE", "UNKNOWN"])
def test_torn_intent_was_never_written_and_without_another_record_the_pass_is_unknown(
    bench: NodeBench, torn: str, written: int
) -> None:
    """And nothing is energised before the next power-up."""
    if torn != "INTENT":
        assert bench.raw(bench.routine(Routine.PASS, 1, 0, option=b"\0")) == b"\x7f\x31\x78"
        bench.tick(20)
    bench.tear(written)
    if torn == "UNKNOWN":
        stop(bench)
    elif torn == "INTENT":
        assert bench.jet(1) == -Nrc.FAILED
    bench.tick(200)
    assert bench.state_and_cause() == ("FAULT", Fault.JOURNAL_DAMAGED)
    assert bench.gate_openings == (torn != "INTENT")
    bench.tear(-1)
    assert bench.clear(option=1) == -Nrc.CONDITIONS, "a journal is read at power-up only"
    reboot(bench)
    assert (known(bench, 0), bench.state().unknown) == ((NEVER, 0) if torn == "INTENT" else (UNKNOWN, 1))
    assert bench.clear(option=1) == DONE
    assert bench.download(pattern_blob(FULL), 1) == (0 if torn == "INTENT" else -Nrc.SEQUENCE)


def test_record_that_the_flash_holds_wrongly_energises_nothing(bench: NodeBench) -> None:
    bench.wear()
    assert bench.jet(1) == -Nrc.FAILED
    assert bench.state_and_cause() == ("FAULT", Fault.JOURNAL_DAMAGED)
    assert bench.gate_openings == 0


def test_altered_record_is_not_believed(bench: NodeBench) -> None:
    assert bench.jet(1) == DONE
    assert bench.journal()[-2:] == [(INTENT, 4, 0), (DONE_RECORD, 4, 0)]
    newest = len(bench.journal()) - 1
    bench.storage()[newest * RECORD + 21] ^= 1
    reboot(bench)
    assert bench.state().unknown == 1


@pytest.mark.parametrize(
    ("where", "byte"),
    [(4, 0), (4, 8), (5, 7), (6, 4), (6, 255), (20, 255), (20, 2), (20, 3), (21, 16), (22, 16), (23, 16)],
)
def test_record_of_another_firmware_is_not_believed(bench: NodeBench, where: int, byte: int) -> None:
    """Its checksum may be right and its kinds, passes and masks impossible."""
    before = bench.state()
    record = bytearray(bench.storage()[(len(bench.journal()) - 1) * RECORD :][:RECORD].tobytes())
    record[:4], record[12:14], record[where] = pack(">I", 1000), b"\0\x4d", byte
    record[36:] = pack(">I", zlib.crc32(record[:36]))
    bench.storage()[3 * SECTOR :][:RECORD] = list(record)
    reboot(bench)
    state = bench.state()
    assert (state.layer, state.passes, state.done, state.boots) == (before.layer, 4, 0, before.boots + 1)


def test_unknown_pass_given_up_by_an_interlock_is_reported_at_once_and_after_a_reboot(bench: NodeBench) -> None:
    bench.raw(bench.routine(Routine.PASS, 1, 0, option=b"\x00"))
    bench.tick(30)
    bench.stop(True)
    bench.stop(False)
    assert bench.state().unknown == 1
    assert 0 < np.count_nonzero(bench.surface) < 72, "part of the pass is on the substrate"
    reboot(bench)
    assert bench.state().unknown == 1
    assert bench.clear(option=1) == DONE
    reboot(bench)
    assert bench.clear() == DONE, "the person is remembered, and so is the pass"
    assert bench.state().unknown == 1


def test_unknown_cure_is_repeated_by_a_person_s_leave(bench: NodeBench) -> None:
    bench.raw(bench.routine(Routine.CURE, 1, 0, option=b"\x01\x00"), CURE)
    bench.tick(50)
    reboot(bench, CURE)
    assert bench.raw(bench.routine(Routine.CURE, 1, 0, kind=3), CURE)[4] == UNKNOWN
    assert bench.clear(CURE) == -Nrc.CONDITIONS
    assert bench.clear(CURE, 1) == DONE
    assert bench.cure(1, attempt=2) == DONE
    assert bench.cure(1, attempt=3) == DONE_BEFORE


def leave_a_pass_unknown(bench: NodeBench) -> None:
    """Power fails while it is jetted, and a person has looked at it."""
    bench.ready()
    assert bench.download(pattern_blob(FULL), 1) == 0
    bench.raw(bench.routine(Routine.PASS, 1, 0, option=b"\x00"))
    bench.tick(20)
    reboot(bench)
    assert bench.clear(option=1) == DONE


def test_boots_are_counted_and_the_ring_forgets_only_what_is_old(bench: NodeBench) -> None:
    """408 records fit; the newest one survives every turn of the ring."""
    bench.print_layer(FULL, 1)
    for _ in range(1000):
        bench.power_up()
    bench.tick(100)
    state = bench.state()
    assert (state.boots, state.layer, state.done) == (1001, 1, 15)
    assert len(bench.journal()) == 100


@pytest.mark.parametrize("written", [0, 3, RECORD - 1])
def test_ring_continues_after_a_record_torn_at_any_place(bench: NodeBench, written: int) -> None:
    for turn in range(450):
        bench.power_up()
        if turn % 7 == 0:
            bench.tear(written)
            bench.tick(100)
            bench.clear(option=1)
    bench.power_up()
    assert bench.state().layer == 1
    assert bench.state().boots == 452


def test_journal_is_newest_first_after_an_erasure_that_was_cut_short(bench: NodeBench) -> None:
    """Old records that such an erasure has left behind its first slot come back nowhere."""
    while unpack_from(">I", bench.raw(b"\x22\x01\x10"), 3)[0] < SECTORS * IN_SECTOR:
        bench.power_up()
    bench.storage()[:RECORD] = 0xFF
    for _ in range(3):
        bench.power_up()
    records = bench.raw(b"\x22\x01\x10")[3:]
    numbers = [unpack_from(">I", records, at)[0] for at in range(0, len(records), RECORD)]
    newest = SECTORS * IN_SECTOR + 3
    assert numbers == list(range(newest, newest - len(numbers), -1))


def test_journal_and_surface_outlive_the_process(tmp_path) -> None:
    with NodeBench(folder=tmp_path) as bench:
        bench.ready().print_layer(FULL, 1)
        surface = bench.surface.copy()
    with NodeBench(folder=tmp_path) as bench:
        assert (bench.state().boots, bench.state().layer, bench.state().done) == (2, 1, 15)
        assert bench.surface.tobytes() == surface.tobytes()
    with pytest.raises(ValueError, match="another number of cells"):
        NodeBench(folder=tmp_path, nx=10)
    (tmp_path / "surface.bin").write_bytes(b"a picture")
    with pytest.raises(ValueError, match="not a surface of the emulator"):
        NodeBench(folder=tmp_path)


def test_record_says_what_was_done_of_which_layer_and_when(bench: NodeBench) -> None:
    """Numbers in the order of a record, which the bench's page describes."""
    reboot(bench)
    assert bench.clear() == DONE
    assert bench.download(pattern_blob(FULL), 1) == 0
    for number in (0, 1):
        began = bench.clock
        assert bench.run(Routine.PASS, layer=1, which=number, attempt=3 + number, option=bytes([number])) == DONE
    records = bench.raw(b"\x22\x01\x10")[3:]
    newest, intent = (unpack_from(">I4BIHHI4B2I", records, at) for at in (0, RECORD))
    number, *step, job, layer, boots, crc, passes, done, unknown, cured, flags, time = newest
    assert (step, job, layer, boots) == ([DONE_RECORD, 4, 1, 4], 7, 1, 2)
    assert (crc, passes, done, unknown, cured, flags) == (zlib.crc32(pattern_blob(FULL)), 4, 3, 0, 0, 0)
    assert intent[0] == number - 1
    assert list(intent[1:5]) == [INTENT, 4, 1, 4]
    assert (intent[9], intent[10]) == (4, 1)
    assert intent[-1] == began < time <= bench.clock


def test_unknown_cure_asks_for_a_person_although_one_has_seen_the_unknown_pass() -> None:
    with NodeBench(one_node=1) as bench:
        leave_a_pass_unknown(bench)
        bench.raw(bench.routine(Routine.CURE, 1, 0, option=b"\x01\x00"))
        bench.tick(20)
        reboot(bench)
        assert bench.state().needs_operator
        assert bench.clear() == -Nrc.CONDITIONS


def test_node_without_a_pattern_counts_its_boots_through_its_layers(bench: NodeBench) -> None:
    for _ in range(2):
        reboot(bench, CURE)
    assert bench.clear(CURE) == DONE
    for layer in (1, 2):
        assert bench.cure(layer) == DONE
    assert bench.state(CURE).boots == 3
    reboot(bench, CURE)
    assert (bench.state(CURE).boots, bench.state(CURE).layer) == (4, 2)


def test_layer_of_one_pass_and_a_scan_are_known_after_a_power_failure() -> None:
    with NodeBench() as bench:
        bench.ready()
        assert bench.download(pattern_blob(FULL, passes=1), 1) == 0
        assert bench.jet(1, colour=255) == DONE
        assert bench.scan(3) == DONE
        assert bench.journal(PROFILER)[-2:] == [(INTENT, 6, 0), (DONE_RECORD, 6, 0)]
        for node in (HEAD, PROFILER):
            reboot(bench, node)
        assert (bench.state().passes, bench.state().done) == (1, 1)
        assert bench.state(PROFILER).layer == 3


def test_interrupted_cure_leaves_its_layer_unknown_until_one_is_repeated(bench: NodeBench) -> None:
    def cures() -> list[int]:
        return [bench.raw(bench.routine(Routine.CURE, 1, number, kind=3), CURE)[4] for number in (0, 1, 2)]

    assert bench.cure(1, 0) == DONE
    assert cures() == [DONE_BEFORE, NEVER, NEVER]
    bench.raw(bench.routine(Routine.CURE, 1, 1, option=b"\x01\x00"), CURE)
    bench.tick(50)
    reboot(bench, CURE)
    assert cures() == [UNKNOWN, UNKNOWN, UNKNOWN], "the flag is one of the layer"
    assert bench.clear(CURE, 1) == DONE
    assert bench.cure(1, 1) == DONE
    assert cures() == [DONE_BEFORE, DONE_BEFORE, NEVER]


def test_surface_keeps_its_shape_and_the_number_of_its_scans(tmp_path) -> None:
    with NodeBench(folder=tmp_path) as bench:
        bench.ready()
        assert [bench.scan(0, attempt=attempt) for attempt in (1, 2)] == [DONE, DONE]
    with pytest.raises(ValueError, match="another number of cells"):
        NodeBench(folder=tmp_path, nx=8, ny=9)
    with NodeBench(folder=tmp_path) as bench:
        frame = bench.measured(PROFILER, ctypes.create_string_buffer(64), bench.clock)
        assert frame
        assert unpack_from("<H", frame.data, 4)[0] == 2


@pytest.mark.parametrize(("passed", "lines"), [(10, 0), (40, 3), (85, 8)])
def test_pass_that_is_cut_off_has_printed_the_lines_that_there_was_time_for(passed: int, lines: int) -> None:
    """9 lines of 8 droplets in 90 ms."""
    with NodeBench(pass_ms=90, gate_ms=0) as bench:
        bench.ready()
        assert bench.download(pattern_blob(FULL, passes=1), 1) == 0
        bench.raw(bench.routine(Routine.PASS, 1, option=b"\xff"))
        while bench.state().step == 0 or not bench.times().gate_opened:
            bench.tick()
        bench.tick(5)
        bench.tick(passed, step=1)
        bench.stop(True)
        frame = bench.measured(HEAD, ctypes.create_string_buffer(64), bench.clock)
        assert frame
        assert unpack_from("<I", frame.data, 4)[0] // 8 in (lines, lines + 1)
