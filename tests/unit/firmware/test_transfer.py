"""Patterns and height maps as they cross the bus: no byte is lost, invented or misread."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from struct import Struct, pack
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from support.benches.node_bench import DONE, PROFILER, NodeBench, heights, pattern_blob, run_length
from support.numpy.philox_numpy import uniform_map, uniforms

PATTERNS = st.tuples(st.integers(1, 12), st.integers(1, 12)).flatmap(
    lambda shape: arrays.arrays(np.uint8, shape, elements=st.integers(0, 2))
)
BLOB = pattern_blob(np.ones((9, 8)))
RANGE, SEQUENCE, LENGTH, SUSPENDED, CHECKSUM, COUNTER = 0x31, 0x24, 0x13, 0x71, 0x72, 0x73


DROPLET, NOZZLE = 1, 4
"""Random streams of the printer."""


@pytest.fixture
def bench() -> Iterator[NodeBench]:
    with NodeBench() as made:
        yield made.ready()


def begin(size: int, layer: int = 1, coded: int = 0) -> bytes:
    return pack(">BBBII", 0x34, coded, 0x44, layer, size)


def jetted(pattern: np.ndarray, blob: bytes, *, coded: int = 0, block: int = 4093) -> np.ndarray:
    """The cells of a pattern that droplets fell on, by an ink that stays where it falls and shows its material."""
    nx, ny = pattern.shape
    inks: dict[str, Any] = {"h1_a": 1.0, "h2_a": 0.0, "h3_a": 0.0, "h1_b": 2.0, "h2_b": 0.0, "h3_b": 0.0}
    with NodeBench(nx=nx, ny=ny, **inks) as bench:
        bench.ready()
        assert bench.download(blob, 1, coded=coded, block=block) == 0
        assert bench.jet(1, colour=255) == DONE
        return bench.surface.copy()


@settings(max_examples=40)
@given(PATTERNS, st.integers(1, 30))
def test_what_is_packed_is_jetted(pattern: np.ndarray, block: int) -> None:
    blob = pattern_blob(pattern, passes=1)
    np.testing.assert_array_equal(jetted(pattern, blob, block=block), pattern)
    np.testing.assert_array_equal(jetted(pattern, run_length(blob), coded=0x10, block=block), pattern)
    one = np.minimum(pattern, 1)
    np.testing.assert_array_equal(jetted(one, pattern_blob(one, passes=1, bits=1)), one)


@pytest.mark.parametrize("bits", [1, 2])
def test_largest_pattern_goes_through(bits: int) -> None:
    pattern = np.random.default_rng(0).integers(0, bits + 1, (1000, 1000)).astype(np.uint8)
    with NodeBench(nx=1000, ny=1000) as bench:
        bench.ready()
        assert bench.download(pattern_blob(pattern, bits=bits), 1) == 0
        assert bench.state().state == "VERIFIED"


def test_colours_share_a_layer_out(bench: NodeBench) -> None:
    assert bench.download(BLOB, 1) == 0
    i, j = np.indices((9, 8))
    for number, colour in enumerate((3, 1, 0, 2)):
        before = bench.surface.copy()
        assert bench.jet(1, number, colour) == DONE
        grown = bench.surface - before >= 4.4e-6
        np.testing.assert_array_equal(grown, 2 * (i % 2) + j % 2 == colour)


def test_droplets_vary_by_cell_layer_and_nozzle_as_those_of_the_models() -> None:
    own: dict[str, Any] = {
        "variation": 0.4,
        "nozzle_variation": 0.3,
        "nozzle_pitch": 2,
        "printer_seed": 7,
        "sensor_seed": 8,
    }
    ink: dict[str, Any] = {"h1_a": 1.0, "h2_a": 0.0, "h3_a": 0.0}
    nozzles = 1.0 - 0.3 * np.array([uniforms(7, NOZZLE, number, 0)[0] for number in (0, 1, 0)])
    with NodeBench(nx=5, ny=3, **own, **ink) as bench:
        bench.ready()
        for layer in (1, 2):
            before = bench.surface.copy()
            assert bench.download(pattern_blob(np.ones((5, 3)), passes=1), layer) == 0
            assert bench.jet(layer, colour=255) == DONE
            factors = (1.0 - 0.4 * uniform_map(7, DROPLET, (5, 3), layer)) * nozzles
            np.testing.assert_allclose(bench.surface - before, factors, rtol=1e-12)


@pytest.mark.parametrize(
    ("head", "code"),
    [
        (pack(">BBHHBB", 2, 1, 9, 9, 4, 0), RANGE),
        (pack(">BBHHBB", 1, 3, 9, 9, 4, 0), RANGE),
        (pack(">BBHHBB", 1, 1, 0, 9, 4, 0), RANGE),
        (pack(">BBHHBB", 1, 1, 9, 9, 2, 0), RANGE),
        (pack(">BBHHBB", 1, 1, 9, 9, 4, 1), RANGE),
        (pack(">BBHHBB", 1, 1, 1000, 1000, 4, 0), RANGE),
        (pack(">BBHHBB", 1, 1, 65535, 65535, 4, 0), RANGE),
    ],
)
def test_pattern_that_this_head_cannot_print_is_refused(bench: NodeBench, head: bytes, code: int) -> None:
    assert bench.download(head + bytes(11), 1) == -code
    assert (bench.state().state, bench.state().passes) == ("IDLE", 0)


def test_pattern_whose_bits_overflow_a_word_is_refused() -> None:
    """65535 x 32769 cells of two bits: modulo 2^32 they would take 8192 bytes, for which this head has room."""
    with NodeBench(nx=200, ny=200) as bench:
        bench.ready()
        assert bench.raw(begin(8 + 8192))[0] == 0x74
        assert bench.raw(b"\x36\x01" + pack(">BBHHBB", 1, 2, 65535, 32769, 4, 0)) == bytes((0x7F, 0x36, RANGE))


def test_block_is_taken_once_and_only_in_its_turn(bench: NodeBench) -> None:
    first, second = b"\x36\x01" + BLOB[:10], b"\x36\x02" + BLOB[10:]
    assert bench.raw(first) == bytes((0x7F, 0x36, SEQUENCE))
    assert bench.raw(begin(len(BLOB))) == bytes.fromhex("74200FFF")
    assert bench.raw(b"\x36\x00" + BLOB[:10]) == bench.raw(second) == bytes((0x7F, 0x36, COUNTER))
    assert bench.raw(first) == bench.raw(first) == b"\x76\x01"
    assert bench.raw(b"\x37" + bytes(4)) == bytes((0x7F, 0x37, SEQUENCE)), "not all there yet"
    assert bench.raw(second) == bench.raw(second) == b"\x76\x02"
    end = pack(">BI", 0x37, zlib.crc32(BLOB))
    assert bench.raw(end) == bench.raw(end) == pack(">BI", 0x77, zlib.crc32(BLOB))
    assert bench.state().state == "VERIFIED"


def test_layer_beyond_16_bits_is_refused_and_not_taken_for_a_low_one(bench: NodeBench) -> None:
    assert bench.raw(begin(26, layer=0x10001)) == bytes((0x7F, 0x34, RANGE))
    assert bench.raw(begin(26, layer=0xFFFF))[0] == 0x74
    assert bench.download(BLOB, 1) == 0


@pytest.mark.parametrize("request_", ["34", "3400440000000100", "36", "3601", "37", "3100", "220100FF", "10", "3E"])
def test_cut_off_request_is_refused_for_its_length(bench: NodeBench, request_: str) -> None:
    bench.raw(begin(29))
    answer = bench.raw(bytes.fromhex(request_))
    assert answer[0] == 0x7F
    assert answer[2] in (LENGTH, 0x12 if request_ == "3100" else LENGTH)


def test_counter_continues_with_0_after_255() -> None:
    with NodeBench(nx=100, ny=100) as bench:
        bench.ready()
        assert bench.download(pattern_blob(np.ones((100, 100))), 1, block=3) == 0


def test_block_of_a_map_may_be_asked_for_in_smaller_pieces(bench: NodeBench) -> None:
    """A repeat with a lower limit is the front of the block, and the rest comes with the next counter."""
    assert bench.scan(0) == DONE
    whole = bench.upload(0)
    bench.raw(pack(">BBBII", 0x35, 0, 0x44, 0, len(whole)), PROFILER)
    assert bench.raw(b"\x36\x01" + pack(">H", 50), PROFILER) == b"\x76\x01" + whole[:50]
    assert bench.raw(b"\x36\x02", PROFILER, 100) == b"\x76\x02" + whole[50:148]
    for most in (40, 90, 40):
        assert bench.raw(b"\x36\x02" + pack(">H", most), PROFILER) == b"\x76\x02" + whole[50:90]
    assert bench.raw(b"\x36\x03\x00\x00", PROFILER) == bytes((0x7F, 0x36, RANGE))
    assert bench.raw(b"\x36\x03" + pack(">H", 5000), PROFILER) == b"\x76\x03" + whole[90:]
    assert bench.raw(b"\x37", PROFILER) == pack(">BI", 0x77, zlib.crc32(whole))


def test_all_blocks_of_a_map_are_of_one_scan(bench: NodeBench) -> None:
    assert bench.scan(0) == DONE
    size = int.from_bytes(bench.raw(b"\x22\x01\x03", PROFILER)[3:7], "big")
    bench.raw(pack(">BBBII", 0x35, 0, 0x44, 0, size), PROFILER)
    assert bench.raw(b"\x36\x01", PROFILER, 100)[0] == 0x76
    assert bench.scan(0, attempt=2) == DONE
    assert bench.raw(b"\x36\x02", PROFILER, 100) == bytes((0x7F, 0x36, SEQUENCE))
    assert bench.upload(0)


def test_node_reports_how_far_a_transfer_has_come(bench: NodeBench) -> None:
    progress = Struct(">BBHIII")
    bench.raw(begin(len(BLOB), layer=1))
    assert progress.unpack(bench.raw(b"\x22\x01\x04")[3:]) == (1, 1, 1, 7, 0, len(BLOB))
    for _ in range(2):
        bench.raw(b"\x36\x01" + BLOB[:10])
        assert progress.unpack(bench.raw(b"\x22\x01\x04")[3:]) == (1, 2, 1, 7, 10, len(BLOB))
    assert bench.scan(0) == DONE
    bench.raw(pack(">BBBII", 0x35, 0, 0x44, 0, 165), PROFILER)
    bench.raw(b"\x36\x01", PROFILER, 100)
    assert progress.unpack(bench.raw(b"\x22\x01\x04", PROFILER)[3:]) == (3, 2, 0, 7, 98, 165)


def test_height_beyond_16_bits_around_the_datum_is_not_valid(bench: NodeBench) -> None:
    """Never a wrong height: steps of 0.1 um, 7 mm between the lowest cell and the highest."""
    bench.surface[:] = 3.5e-3
    bench.surface[0, 0], bench.surface[8, 7] = 0.0, 7e-3
    assert bench.scan(0) == DONE
    height, valid = heights(bench.upload(0), 1e-7)
    assert np.argwhere(~valid).tolist() == [[0, 0], [8, 7]]
    np.testing.assert_allclose(height[valid], 3.5e-3, rtol=1e-9)


def test_large_map_is_whole() -> None:
    with NodeBench(nx=300, ny=200, noise_std=1e-6) as bench:
        bench.ready()
        assert bench.scan(0) == DONE
        found, valid = heights(bench.upload(0), 1e-7)
        assert valid.all()
        assert found.std() == pytest.approx(1e-6, rel=0.02, abs=0.0)
        assert bench.scan(0, attempt=2) == DONE
        again, _ = heights(bench.upload(0), 1e-7)
        assert abs(np.corrcoef(found.ravel(), again.ravel())[0, 1]) < 0.02, "each scan has its own noise"


@pytest.mark.parametrize(("size", "accepted"), [(8, False), (9, True), (44, True), (45, False)])
def test_size_of_a_pattern_has_limits(bench: NodeBench, size: int, accepted: bool) -> None:
    """More than its head, and at most twice the 18 bytes of the grid beside it."""
    answer = bench.raw(begin(size, layer=1))
    assert answer[0] == 0x74 if accepted else answer == bytes((0x7F, 0x34, RANGE))


@pytest.mark.parametrize("shape", [(9, 7), (8, 8), (8, 9)])
def test_pattern_of_another_grid_is_not_jetted(bench: NodeBench, shape: tuple[int, int]) -> None:
    assert bench.download(pattern_blob(np.ones(shape), passes=1), 1) == 0
    assert bench.jet(1, colour=255) < 0
    assert not bench.surface.any()


@pytest.mark.parametrize(
    "spoilt",
    [BLOB[:-1], BLOB + b"\0", pattern_blob(np.full((9, 8), 3)), run_length(BLOB) + b"\x05", run_length(BLOB) + b"\x90"],
    ids=["short", "long", "no such material", "literal bytes begun", "a run begun"],
)
def test_pattern_that_is_not_whole_is_refused_and_the_next_one_taken(bench: NodeBench, spoilt: bytes) -> None:
    coded = 0x10 if spoilt[8:] and spoilt.startswith(run_length(BLOB)) else 0
    assert bench.download(spoilt, 1, coded=coded) == -RANGE
    assert bench.state().state == "IDLE"
    assert bench.download(run_length(BLOB) if coded else BLOB, 1, coded=coded) == 0


def test_pattern_whose_checksum_differs_is_gone_and_can_be_sent_again(bench: NodeBench) -> None:
    """So is the one before it; a repeated exit confirms none."""
    assert bench.download(BLOB, 1) == 0
    assert bench.download(BLOB, 1, crc=zlib.crc32(BLOB) ^ 1) == -CHECKSUM
    assert (bench.state().state, bench.state().pattern_loaded) == ("IDLE", False)
    assert bench.raw(pack(">BI", 0x37, zlib.crc32(BLOB))) == bytes((0x7F, 0x37, SEQUENCE))
    assert bench.download(BLOB, 1) == 0


@pytest.mark.parametrize("begun", [1, 2])
def test_more_bytes_than_announced_end_the_transfer_in_the_state_before_it(bench: NodeBench, begun: int) -> None:
    for _ in range(begun):
        assert bench.raw(begin(len(BLOB)))[0] == 0x74
    assert bench.raw(b"\x36\x01" + BLOB + b"\0") == bytes((0x7F, 0x36, SUSPENDED))
    assert bench.state().state == "IDLE"


@pytest.mark.parametrize(
    ("lowest", "highest", "dropout"),
    [(0.0, 7e-6, 0.3), (5e-3, 5.07e-3, 0.3), (-5e-3, -4.93e-3, 0.0), (0.0, 6.5e-3, 0.0)],
)
def test_map_is_what_the_sensor_read_in_blocks_of_any_size(lowest: float, highest: float, dropout: float) -> None:
    """A datum keeps tall parts in 16 bits; a cell that is not valid reads 0."""
    with NodeBench(dropout_rate=dropout, sensor_seed=4) as bench:
        bench.ready()
        bench.surface[:] = np.linspace(lowest, highest, 72).reshape(9, 8)
        assert bench.scan(0) == DONE
        blob = bench.upload(0)
        assert [bench.upload(0, block=room) for room in (64, 100)] == [blob, blob]
        found, valid = heights(blob, 1e-7)
        assert 0 < valid.sum() < 72 if dropout else valid.all()
        np.testing.assert_allclose(found[valid], bench.surface[valid], atol=0.51e-7)
        assert not np.frombuffer(blob, ">i2", 72, 12)[~valid.ravel()].any()


def test_map_is_refused_before_a_scan_of_another_layer_size_and_form(bench: NodeBench) -> None:
    def upload(layer: int, size: int = 165, form: int = 0) -> bytes:
        return bench.raw(pack(">BBBII", 0x35, form, 0x44, layer, size), PROFILER)

    assert upload(0) == bytes((0x7F, 0x35, SEQUENCE))
    assert bench.scan(0) == bench.scan(1) == DONE
    assert upload(0) == upload(2) == bytes((0x7F, 0x35, SEQUENCE))
    assert upload(1, 164) == upload(1, form=0x10) == bytes((0x7F, 0x35, RANGE))
    assert upload(1)[0] == 0x75
    first = bench.raw(b"\x36\x01", PROFILER, 100)
    assert bench.raw(b"\x36\x01", PROFILER, 100) == first
    assert bench.raw(b"\x36\x02", PROFILER, 100)[2:] != first[2:]
    assert bench.raw(b"\x36\x01", PROFILER, 100) == bytes((0x7F, 0x36, COUNTER))
