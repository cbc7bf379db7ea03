"""Supervision of frames: the firmware's check byte is autosar-e2e's, and both monitors follow the same rules."""

from __future__ import annotations

import ctypes

import pytest
from e2e import p01
from hypothesis import given
from hypothesis import strategies as st

from inkloop_hardware.link.node_watch import E2eMonitor, Verdict
from support.benches.wire_library import numbers, wire_library

pytestmark = pytest.mark.compiled


class MonitorInC:
    def __init__(self) -> None:
        self.library = wire_library()
        self.memory = ctypes.create_string_buffer(self.library.probe_sizes(2))
        self.library.e2e_monitor_init(self.memory)

    def take(self, intact: bool, counter: int) -> Verdict:
        return Verdict(self.library.e2e_monitor_take(self.memory, ctypes.c_bool(intact), ctypes.c_uint8(counter)))

    @property
    def trusted(self) -> bool:
        return bool(self.library.e2e_monitor_trusts(self.memory))

    @property
    def counts(self) -> list[int]:
        found = numbers(5)
        self.library.probe_monitor_counts(self.memory, found)
        return list(found)


def counts(monitor: E2eMonitor) -> list[int]:
    return [monitor.damaged, monitor.repeated, monitor.jumped, monitor.lost, monitor.stuck]


def take_all(monitor: E2eMonitor, counters: list[int]) -> list[Verdict]:
    return [monitor.take(True, counter) for counter in counters]


@given(data=st.binary(min_size=2, max_size=8), data_id=st.integers(0, 0xFFFF), counter=st.integers(0, 14))
def test_firmware_protects_byte_for_byte_as_autosar_e2e(data: bytes, data_id: int, counter: int) -> None:
    theirs = bytearray(data)
    theirs[1] = theirs[1] & 0xF0 | counter
    p01.e2e_p01_protect(theirs, data_id, increment_counter=False)
    ours = ctypes.create_string_buffer(data, len(data))
    library, length, identity = wire_library(), ctypes.c_size_t(len(data)), ctypes.c_uint16(data_id)
    library.e2e_protect(ours, length, identity, ctypes.c_uint8(counter))
    assert ours.raw == bytes(theirs)
    assert library.e2e_check(ours, length, identity)
    assert library.e2e_counter(ours) == counter
    damaged = bytes([ours.raw[0] ^ 1]) + ours.raw[1:]
    assert not library.e2e_check(damaged, length, identity)
    assert not library.e2e_check(ours, length, ctypes.c_uint16(data_id ^ 0x100))
    assert not library.e2e_check(ours, ctypes.c_size_t(1), identity)


def test_counter_goes_round_from_14_to_0() -> None:
    library = wire_library()
    assert [library.e2e_next_counter(ctypes.c_uint8(counter)) for counter in range(16)] == [*range(1, 15), 0, 0]


@given(frames=st.lists(st.tuples(st.integers(0, 9).map(bool), st.one_of(st.none(), st.integers(0, 15)))))
def test_both_monitors_agree(frames: list[tuple[bool, int | None]]) -> None:
    """None: the sender continues as it should."""
    in_python, in_c, last = E2eMonitor(), MonitorInC(), 0
    assert not in_python.trusted
    assert not in_c.trusted
    for intact, found in frames:
        last = (last + 1) % 15 if found is None else found
        assert in_python.take(intact, last) is in_c.take(intact, last)
        assert in_python.trusted == in_c.trusted
        assert counts(in_python) == in_c.counts


def test_steady_sender_is_trusted_all_the_time() -> None:
    monitor = E2eMonitor()
    verdicts = take_all(monitor, [counter % 15 for counter in range(7, 50)])
    assert verdicts == [Verdict.FIRST] + [Verdict.GOOD] * 42
    assert monitor.trusted
    assert counts(monitor) == [0, 0, 0, 0, 0]


def test_nothing_is_trusted_before_the_first_undamaged_frame() -> None:
    monitor = E2eMonitor()
    assert not monitor.trusted
    assert monitor.take(False, 0) is Verdict.DAMAGED
    assert not monitor.trusted
    assert monitor.take(True, 1) is Verdict.FIRST
    assert monitor.trusted


@pytest.mark.parametrize(
    ("step", "verdict", "lost"), [(2, Verdict.LOST, 1), (3, Verdict.LOST, 2), (4, Verdict.JUMPED, 0)]
)
def test_two_lost_frames_are_forgiven_three_are_not(step: int, verdict: Verdict, lost: int) -> None:
    monitor = E2eMonitor()
    assert take_all(monitor, [13, (13 + step) % 15, (14 + step) % 15]) == [Verdict.FIRST, verdict, Verdict.GOOD]
    assert (monitor.lost, monitor.trusted) == (lost, True)


def test_two_bad_frames_of_five_end_trust_and_four_good_ones_after_the_last_restore_it() -> None:
    monitor = E2eMonitor()
    take_all(monitor, [0, 1, 2])
    assert monitor.take(True, 2) is Verdict.REPEATED
    assert monitor.trusted
    take_all(monitor, [3, 4, 5])
    assert monitor.take(False, 6) is Verdict.DAMAGED
    assert not monitor.trusted
    assert monitor.take(True, 7) is Verdict.LOST
    assert monitor.trusted


def test_bad_frames_far_apart_are_borne() -> None:
    monitor = E2eMonitor()
    for counter in range(60):
        assert monitor.take(counter % 5 != 0 or counter == 0, counter % 15) is not Verdict.JUMPED
        assert monitor.trusted
    assert (monitor.damaged, monitor.lost) == (11, 11)


def test_counter_that_stands_is_counted_once_until_it_moves() -> None:
    monitor = E2eMonitor()
    take_all(monitor, [4, 4, 4])
    assert (monitor.repeated, monitor.stuck) == (2, 0)
    take_all(monitor, [4, 4, 4])
    assert (monitor.repeated, monitor.stuck, monitor.trusted) == (5, 1, False)
    take_all(monitor, [5, 6, 7, 8, 9])
    assert monitor.trusted
    take_all(monitor, [9, 9, 9])
    assert (monitor.stuck, monitor.trusted) == (2, False)


def test_counter_that_stands_for_long_is_counted_once() -> None:
    in_python, in_c = E2eMonitor(), MonitorInC()
    for _ in range(600):
        assert in_python.take(True, 4) is in_c.take(True, 4)
    assert counts(in_python) == in_c.counts == [0, 599, 0, 0, 1]


def test_sender_that_restarts_is_trusted_again() -> None:
    monitor = E2eMonitor()
    take_all(monitor, [5, 6, 7])
    assert take_all(monitor, [0, 1]) == [Verdict.JUMPED, Verdict.GOOD]
    assert monitor.trusted
    assert monitor.take(True, 15) is Verdict.DAMAGED
