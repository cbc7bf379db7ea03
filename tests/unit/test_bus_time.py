"""Bits of CAN frames, against frames whose stuff bits are known."""

from __future__ import annotations

import pytest
from benchmarks.bus_time import bus_time, stuff_bits, worst_bits


@pytest.mark.parametrize(("length", "bits"), [(0, 55), (8, 135)])
def test_worst_frame_is_that_of_the_literature(length: int, bits: int) -> None:
    """Davis, Burns, Bril, Lukkien 2007, eq. (1), with 3 bits of intermission: 55 + 10 s bits for s bytes."""
    assert worst_bits(length) == bits


def test_every_fifth_equal_bit_brings_one_of_the_other_value() -> None:
    """An empty frame of id 0 is 34 zeros with its CRC."""
    assert stuff_bits(0, b"") == 34 // 5


def test_alternating_bits_need_none_in_the_data() -> None:
    assert stuff_bits(0x555, b"\x55" * 8) <= 3


def test_sum_of_frames_lies_between_the_unstuffed_and_the_worst() -> None:
    frames = [(0x641, bytes([k % 256] * 8)) for k in range(300)]
    found = bus_time(frames)
    assert found.frames == 300
    assert 300 * 111 < found.bits < found.bits_worst == 300 * 135
    assert found.seconds(1e6)[0] == pytest.approx(found.bits * 1e-6, rel=1e-9, abs=0.0)
