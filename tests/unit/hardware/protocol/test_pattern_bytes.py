"""Patterns and height maps as they cross the bus: the bytes of Python are those of the firmware."""

from __future__ import annotations

import zlib
from struct import pack

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from inkloop_hardware.errors import FrameError
from inkloop_hardware.protocol.transfer_bytes import PatternBytes, map_size, read_map, run_length
from support.benches import node_bench


@pytest.mark.parametrize(("materials", "bits"), [(1, 1), (2, 2)])
def test_packed_pattern_has_a_bit_for_one_material_and_two_for_two(materials: int, bits: int) -> None:
    pattern = np.random.default_rng(1).integers(0, materials + 1, (13, 7))
    found = PatternBytes.of(pattern, passes=4, materials=materials)
    assert found.plain == node_bench.pattern_blob(pattern, passes=4, bits=bits)
    assert len(found.plain) == 8 + -(-13 * 7 * bits // 8) == 8 + PatternBytes.cells_of(13, 7, materials=materials)


@given(arrays.arrays(np.uint8, st.integers(0, 700), elements=st.sampled_from([0, 0, 0, 1, 255])))
@settings(max_examples=200)
def test_run_length_code_is_undone_by_the_rules_of_the_page(cells: np.ndarray) -> None:
    """A byte c < 128 precedes c + 1 literal bytes, any other one byte that is repeated c - 126 times."""
    coded, found = list(run_length(cells)), bytearray()
    while coded:
        head = coded.pop(0)
        found += bytes(coded[: head + 1]) if head < 128 else bytes(coded[:1]) * (head - 126)
        del coded[: head + 1 if head < 128 else 1]
    assert found == cells.tobytes()


def test_run_of_three_is_a_run_and_the_longest_has_129_bytes() -> None:
    assert run_length(np.array([7, 7, 7], np.uint8)) == bytes([129, 7])
    assert run_length(np.full(132, 7, np.uint8)) == bytes([255, 7, 129, 7])
    assert run_length(np.full(131, 7, np.uint8)) == bytes([255, 7, 128, 7]), "two at the end of a run are one, too"
    assert run_length(np.full(130, 7, np.uint8)) == bytes([255, 7, 0, 7])
    assert run_length(np.array([7, 7], np.uint8)) == bytes([1, 7, 7])


def test_solid_layer_is_shorter_coded_and_a_dithered_one_is_not() -> None:
    solid = PatternBytes.of(np.ones((100, 100)), passes=1, materials=1)
    dithered = PatternBytes.of(np.random.default_rng(2).integers(0, 2, (100, 100)), passes=1, materials=1)
    assert solid.is_shorter_coded
    assert len(solid.coded) < 40
    assert not dithered.is_shorter_coded


@pytest.mark.compiled
@pytest.mark.parametrize("coded", [False, True])
def test_both_forms_print_the_same_surface(coded: bool) -> None:
    pattern = np.random.default_rng(3).integers(0, 3, (12, 17))
    pattern[3:9] = 1
    made = PatternBytes.of(pattern, passes=4, materials=2)
    with node_bench.NodeBench(nx=12, ny=17) as bench, node_bench.NodeBench(nx=12, ny=17) as same:
        for one, blob, form in ((bench, made.coded if coded else made.plain, coded), (same, made.plain, False)):
            one.ready()
            assert one.download(blob, 1, coded=0x10 * form) == 0
            for number in range(4):
                assert one.jet(1, number) == node_bench.DONE
        assert bench.surface.any()
        np.testing.assert_array_equal(bench.surface, same.surface)


@pytest.mark.compiled
def test_journal_knows_which_form_it_took() -> None:
    made = PatternBytes.of(np.ones((9, 9)), passes=4, materials=1)
    for coded, blob in ((True, made.coded), (False, made.plain)):
        with node_bench.NodeBench() as bench:
            bench.ready()
            assert bench.download(blob, 1, coded=0x10 * coded) == 0
            assert made.form_of(bench.state().pattern_crc) is coded
    assert made.form_of(zlib.crc32(b"another")) is None


@pytest.mark.parametrize(
    ("pattern", "materials", "word"),
    [
        (np.full((3, 3), 2), 1, "0 to 1"),
        (np.full((3, 3), -1), 2, "-1"),
        (np.ones((1001, 1000)), 1, "1000000"),
        (np.ones(9), 1, "two dimensions"),
        (np.ones((3, 3)), 3, "3 materials"),
    ],
)
def test_pattern_that_the_bus_cannot_carry_is_refused_with_a_message(
    pattern: np.ndarray, materials: int, word: str
) -> None:
    with pytest.raises(ValueError, match=word):
        PatternBytes.of(pattern, passes=1, materials=materials)


@pytest.mark.compiled
def test_map_of_a_node_is_read_to_the_bit() -> None:
    nx, ny = 11, 9
    with node_bench.NodeBench(nx=nx, ny=ny, noise_std=1e-6, dropout_rate=0.1, sensor_seed=3) as bench:
        bench.ready()
        bench.surface[:] = np.random.default_rng(4).uniform(0.0, 20e-6, (nx, ny))
        assert bench.scan(0) == node_bench.DONE
        blob = bench.upload(0)
    expected, marks = node_bench.heights(blob, 1e-7)
    found, valid = read_map(blob, nx, ny)
    assert 0 < marks.sum() < marks.size
    np.testing.assert_array_equal(valid, marks)
    np.testing.assert_array_equal(found, expected)


@pytest.mark.compiled
def test_part_that_outgrew_16_bits_is_read_from_its_datum() -> None:
    """A cell that is not valid has height 0 whatever the datum."""
    with node_bench.NodeBench(nx=5, ny=5) as bench:
        bench.ready()
        bench.surface[:] = 5e-3 + 1e-7 * np.arange(25).reshape(5, 5)
        assert bench.scan(0) == node_bench.DONE
        found, valid = read_map(bench.upload(0), 5, 5)
        assert valid.all()
        np.testing.assert_allclose(found, bench.surface, atol=1e-12)
    found, valid = read_map(pack(">BBHHHi", 1, 0, 1, 2, 100, 500) + pack(">hh", 1, 0) + b"\x80", 1, 2)
    assert (found.tolist(), valid.tolist()) == ([[501 * 1e-7, 0.0]], [[True, False]])


@pytest.mark.parametrize("nanometres", [1, 3, 7, 40, 100, 1000, 65535])
def test_step_of_a_map_is_the_double_of_the_sensors_parameter(nanometres: int) -> None:
    head = pack(">BBHHHi", 1, 0, 1, 1, nanometres, 0)
    found, _ = read_map(head + pack(">h", 1) + b"\x80", 1, 1)
    assert found[0, 0] == float(f"{nanometres}e-9")


@pytest.mark.parametrize(
    ("blob", "word"),
    [
        (b"\1\0", "2 bytes"),
        (pack(">BBHHHi", 2, 0, 3, 3, 100, 0) + bytes(20), "version 2"),
        (pack(">BBHHHi", 1, 0, 3, 4, 100, 0) + bytes(26), "3 x 4"),
        (pack(">BBHHHi", 1, 0, 3, 3, 100, 0) + bytes(19), f"take {map_size(3, 3)} bytes"),
        (pack(">BBHHHi", 1, 0, 3, 3, 0, 0) + bytes(20), "steps of 0 nm"),
    ],
)
def test_bytes_that_are_no_map_of_the_grid_are_refused_with_a_message(blob: bytes, word: str) -> None:
    with pytest.raises(FrameError, match=word):
        read_map(blob, 3, 3)
