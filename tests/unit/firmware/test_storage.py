"""The journal on real storage: slots that refuse or cannot be read, words of flash, an erasure that takes its time."""

from __future__ import annotations

from collections.abc import Iterator
from struct import unpack_from

import numpy as np
import pytest

from inkloop_hardware.protocol.records import Fault
from inkloop_hardware.protocol.services import Routine
from support.benches.node_bench import CURE, DONE, DONE_BEFORE, UNKNOWN, MasterAlive, NodeBench, Nrc, pattern_blob

PATTERN = pattern_blob(np.ones((9, 8)))
RECORD, SECTOR, IN_SECTOR, SLOTS = 40, 4096, 102, 408
JETTED = 4
"""Records of the head after a pass: BOOT, PATTERN, INTENT, DONE."""


@pytest.fixture
def bench() -> Iterator[NodeBench]:
    with NodeBench() as made:
        yield made


def jet_pass_0(bench: NodeBench, layer: int = 1) -> None:
    bench.ready()
    assert bench.download(PATTERN, layer) == 0
    assert bench.jet(layer) == DONE


def restart(bench: NodeBench) -> None:
    bench.power_up()
    bench.tick(100)


def numbers(bench: NodeBench) -> list[int]:
    """Of the records that can be read, newest first."""
    records = bench.raw(b"\x22\x01\x10")[3:]
    return [unpack_from(">I", records, at)[0] for at in range(0, len(records), RECORD)]


def fill(bench: NodeBench, records: int) -> None:
    """Power up until there are so many records."""
    while numbers(bench)[0] < records:
        bench.power_up()


def test_slot_that_reads_erased_and_refuses_writing_is_skipped_at_every_power_up(bench: NodeBench) -> None:
    fill(bench, 10)
    bench.refuse_slots(10, 12)
    for boots in range(11, 14):
        restart(bench)
        assert (bench.state().state, bench.state().cause, bench.state().boots) == ("SAFE", 0, boots)
    assert bench.clear() == DONE
    assert np.all(bench.storage()[10 * RECORD : 12 * RECORD] == 0xFF)
    assert sorted(numbers(bench), reverse=True) == numbers(bench)
    assert len(numbers(bench)) == 13


@pytest.mark.parametrize("before", [1, 50, IN_SECTOR])
def test_newest_record_stays_where_nothing_can_be_written_any_more(bench: NodeBench, before: int) -> None:
    """Its sector is never erased for want of another place."""
    jet_pass_0(bench)
    fill(bench, max(before, numbers(bench)[0]))
    bench.refuse_slots(0, SLOTS)
    for _ in range(3):
        restart(bench)
        assert bench.state_and_cause() == ("FAULT", Fault.JOURNAL_DAMAGED)
        assert bench.state().done == 1
    bench.restore()
    restart(bench)
    assert (bench.state().state, bench.state().done) == ("SAFE", 1)


@pytest.mark.parametrize("lost", range(1, 1 + JETTED))
def test_records_that_cannot_be_read_are_not_taken_for_none(bench: NodeBench, lost: int) -> None:
    """A person is asked; nothing is jetted, recorded or said never to have begun. Read again, all is known again."""
    jet_pass_0(bench)
    bench.decay(lost)
    stored = bench.storage().copy()
    restart(bench)
    state = bench.state()
    assert (state.state, state.cause) == ("SAFE", Fault.JOURNAL_UNREADABLE)
    assert state.needs_operator
    assert state.journal_unread
    for option in (0, 1, 2):
        assert bench.clear(option=option) == -Nrc.CONDITIONS
    assert bench.download(PATTERN, 1) == -Nrc.CONDITIONS
    assert bench.raw(bench.routine(Routine.PASS, 1, 0, kind=3))[4] == UNKNOWN
    bench.stop(True)
    bench.stop(False)
    assert bench.clear(option=1) == -Nrc.CONDITIONS, "also after another cause"
    assert bench.storage().tobytes() == stored.tobytes()
    bench.restore()
    restart(bench)
    assert (bench.state().cause, bench.state().done, bench.state().journal_unread) == (0, 1, False)
    assert bench.clear() == DONE
    assert bench.jet(1) == DONE_BEFORE
    assert bench.gate_openings == 1


def test_what_older_records_hold_is_known_although_newer_ones_cannot_be_read(bench: NodeBench) -> None:
    jet_pass_0(bench)
    assert bench.jet(1, 1) == DONE
    bench.decay(2)
    restart(bench)
    outcomes = [bench.raw(bench.routine(Routine.PASS, 1, number, kind=3))[4] for number in range(3)]
    assert outcomes == [DONE_BEFORE, UNKNOWN, UNKNOWN]


@pytest.mark.parametrize("lost", [1, 2])
@pytest.mark.parametrize("comes_back", [False, True])
def test_job_of_a_journal_that_is_given_up_is_over(bench: NodeBench, lost: int, comes_back: bool) -> None:
    """Any of its layers may be jetted. Lost records that can be read again later change nothing."""
    jet_pass_0(bench)
    bench.decay(lost)
    restart(bench)
    boots = bench.state().boots
    assert bench.clear(option=3) == DONE
    assert bench.state().boots == boots
    for again in range(3):
        for layer in (1, 2, 3, 65535):
            assert bench.download(PATTERN, layer) == -Nrc.SEQUENCE, (again, layer)
        if comes_back:
            bench.restore()
        restart(bench)
        assert bench.clear() == DONE
    bench.master = MasterAlive(7, 1, 8)
    bench.tick(100)
    assert bench.download(PATTERN, 1) == 0
    assert bench.gate_openings == 1


@pytest.mark.parametrize(
    ("newest", "slots", "asked"),
    [
        (149, range(149), False),  # older in the newest record's sector, and the sector before it
        (149, range(150, 151), True),  # where the next record would be
        (149, range(203, 204), True),
        (149, range(204, 205), False),  # records behind it show that the next sector was not erased since
        (149, range(204, 306), True),
        (149, range(306, SLOTS), False),
        (203, range(204, 205), False),  # the newest record is the last one of its sector
        (203, range(204, 306), True),
        (203, range(306, SLOTS), False),
    ],
)
def test_only_what_may_be_newer_asks_a_person(bench: NodeBench, newest: int, slots: range, asked: bool) -> None:
    """The ring of 408 slots has gone round once."""
    fill(bench, SLOTS + newest + 1)
    bench.decay_slots(slots)
    restart(bench)
    assert (bench.state().cause == Fault.JOURNAL_UNREADABLE) == asked
    assert bench.clear() == (-Nrc.CONDITIONS if asked else DONE)


def test_records_of_several_sectors_that_come_back_are_older_than_those_after_they_were_given_up(
    bench: NodeBench,
) -> None:
    fill(bench, 350)
    bench.decay_slots(range(5, 350))
    restart(bench)
    assert bench.clear(option=3) == DONE
    newest = numbers(bench)[0]
    bench.restore()
    restart(bench)
    assert numbers(bench)[:2] == [newest + 1, newest]


def test_memory_that_cannot_be_read_at_all_is_no_empty_one(bench: NodeBench) -> None:
    bench.decay_slots(range(SLOTS))
    restart(bench)
    assert bench.state_and_cause() == ("SAFE", Fault.JOURNAL_UNREADABLE)
    assert bench.raw(b"\x22\x01\x10")[3:] == b""
    assert bench.clear(option=3) == DONE


@pytest.mark.parametrize(
    ("sectors", "sector_bytes", "write_unit"),
    [(1, SECTOR, 8), (0, SECTOR, 8), (2, SECTOR, 24), (2, SECTOR, 64), (2, 4090, 8), (2, 32, 8), (4, 48, 32)],
)
def test_memory_that_is_none_for_a_journal_keeps_the_node_in_fault(
    bench: NodeBench, sectors: int, sector_bytes: int, write_unit: int
) -> None:
    bench.memory(sectors, sector_bytes, write_unit)
    restart(bench)
    assert bench.state_and_cause() == ("FAULT", Fault.JOURNAL_DAMAGED)
    assert bench.clear(option=3) == -Nrc.CONDITIONS
    assert bench.raw(b"\x22\x01\x10")[3:] == b""


@pytest.mark.parametrize("write_unit", [0, 1, 2, 8, 16, 32])
@pytest.mark.parametrize("sector_bytes", [SECTOR, 64])
def test_records_are_whole_words_of_the_flash(bench: NodeBench, write_unit: int, sector_bytes: int) -> None:
    """The board refuses anything else, and a word that is not erased; the ring goes round."""
    bench.storage()[:] = 0xFF
    bench.memory(2, sector_bytes, write_unit)
    restart(bench)
    jet_pass_0(bench)
    for _ in range(300):
        bench.power_up()
    bench.tick(100)
    assert (bench.state().state, bench.state().boots, bench.state().done) == ("SAFE", 301, 1)


@pytest.mark.parametrize("milliseconds", [0, 290])
def test_cure_gets_all_of_its_light_after_an_erasure(milliseconds: int) -> None:
    """Its INTENT is the first record of a sector: the lamp is lit by the clock after the erasure."""
    with NodeBench(watchdog_ms=0) as bench:
        bench.ready()
        for _ in range(IN_SECTOR - 1):
            bench.power_up(CURE)
        bench.tick(100)
        assert bench.clear(CURE) == DONE
        bench.storage(CURE)[SECTOR] = 0
        bench.erase_slowly(milliseconds, CURE)
        assert bench.raw(bench.routine(Routine.CURE, 1, option=b"\0\x64"), CURE) == b"\x7f\x31\x78"
        assert bench.world_clock == bench.clock + milliseconds
        bench.clock += milliseconds
        bench.send_keep_alive()
        bench.tick(200)
        assert bench.late(CURE)[4:5] == bytes([DONE])
        times = bench.times(CURE)
        assert times.lamp_off - times.lamp_on == 100
        assert times.lamp_on == bench.clock - 195
