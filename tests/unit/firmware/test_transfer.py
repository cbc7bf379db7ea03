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

from support.benches.node_bench import DONE, HEAD, PROFILER, NodeBench, heights, pattern_blob, run_length

PATTERNS = st.tuples(st.integers(1, 12), st.integers(1, 12)).flatmap(
    lambda shape: arrays.arrays(np.uint8, shape, elements=st.integers(0, 2))
)
RANGE, SEQUENCE, LENGTH, SUSPENDED, CHECKSUM, COUNTER = 0x31, 0x24, 0x13, 0x71, 0x72, 0x73


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
    assert bench.download(pattern_blob(np.ones((9, 8))), 1) == 0
    i, j = np.indices((9, 8))
    for number, colour in enumerate((3, 1, 0, 2)):
        before = bench.surface.copy()
        assert bench.jet(1, number, colour) == DONE
        grown = bench.surface - before >= 4.4e-6
        np.testing.assert_array_equal(grown, 2 * (i % 2) + j % 2 == colour)


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


@pytest.mark.parametrize("change", [-1, 1])
def test_pattern_of_another_length_than_its_header_states_is_refused(bench: NodeBench, change: int) -> None:
    blob = pattern_blob(np.ones((9, 8)))
    assert bench.download(blob[:-1] if change < 0 else blob + b"\0", 1) == -RANGE
    assert bench.state().state == "IDLE"


@pytest.mark.parametrize("begun", [b"\x05", b"\x90"], ids=["literal bytes", "a run"])
def test_coded_pattern_that_ends_before_its_last_code_is_refused(bench: NodeBench, begun: bytes) -> None:
    coded = run_length(pattern_blob(np.eye(9, 8)))
    assert bench.download(coded + begun, 1, coded=0x10) == -RANGE
    assert bench.download(coded, 1, coded=0x10) == 0


def test_material_that_does_not_exist_is_refused(bench: NodeBench) -> None:
    assert bench.download(pattern_blob(np.full((9, 8), 3)), 1) == -RANGE


@settings(max_examples=100)
@given(st.binary(min_size=1, max_size=60), st.sampled_from([0, 0x10]))
def test_no_bytes_overrun_the_memory_of_the_pattern(cells: bytes, coded: int) -> None:
    with NodeBench() as bench:
        bench.ready()
        answer = bench.download(pack(">BBHHBB", 1, 2, 9, 9, 1, 0) + cells, 1, coded=coded, block=7)
        assert answer in (0, -RANGE, -SUSPENDED)
        assert bench.state().state == ("IDLE" if answer else "VERIFIED")


def test_altered_byte_is_found_and_the_pattern_can_be_sent_again(bench: NodeBench) -> None:
    blob = pattern_blob(np.ones((9, 8)))
    assert bench.download(blob, 1, crc=zlib.crc32(blob) ^ 1) == -CHECKSUM
    assert not bench.state().pattern_loaded
    assert bench.download(blob, 1) == 0


def test_block_is_taken_once_and_only_in_its_turn(bench: NodeBench) -> None:
    blob = pattern_blob(np.ones((9, 8)))
    first, second = b"\x36\x01" + blob[:10], b"\x36\x02" + blob[10:]
    assert bench.raw(first) == bytes((0x7F, 0x36, SEQUENCE))
    assert bench.raw(begin(len(blob))) == bytes.fromhex("74200FFF")
    assert bench.raw(b"\x36\x00" + blob[:10]) == bench.raw(second) == bytes((0x7F, 0x36, COUNTER))
    assert bench.raw(first) == bench.raw(first) == b"\x76\x01"
    assert bench.raw(b"\x37" + bytes(4)) == bytes((0x7F, 0x37, SEQUENCE)), "not all there yet"
    assert bench.raw(second) == bench.raw(second) == b"\x76\x02"
    end = pack(">BI", 0x37, zlib.crc32(blob))
    assert bench.raw(end) == bench.raw(end) == pack(">BI", 0x77, zlib.crc32(blob))
    assert bench.state().state == "VERIFIED"


def test_layer_beyond_16_bits_is_refused_and_not_taken_for_a_low_one(bench: NodeBench) -> None:
    assert bench.raw(begin(26, layer=0x10001)) == bytes((0x7F, 0x34, RANGE))
    assert bench.download(pattern_blob(np.ones((9, 8))), 1) == 0


def test_transfer_that_is_begun_again_and_given_up_leaves_the_state_of_before(bench: NodeBench) -> None:
    for _ in range(2):
        assert bench.raw(begin(26))[0] == 0x74
    assert bench.raw(b"\x36\x01" + bytes(27)) == bytes((0x7F, 0x36, SUSPENDED))
    assert bench.state().state == "IDLE"


def test_end_of_a_pattern_that_was_refused_is_refused_when_it_is_repeated(bench: NodeBench) -> None:
    """With any checksum: the node has no pattern."""
    blob = pattern_blob(np.ones((9, 8)))
    assert bench.download(blob, 1, crc=zlib.crc32(blob) ^ 1) == -CHECKSUM
    assert bench.raw(pack(">BI", 0x37, zlib.crc32(blob))) == bytes((0x7F, 0x37, SEQUENCE))
    assert bench.state().state == "IDLE"


def test_more_bytes_than_announced_end_the_transfer(bench: NodeBench) -> None:
    blob = pattern_blob(np.ones((9, 8)))
    bench.raw(begin(len(blob)))
    assert bench.raw(b"\x36\x01" + blob + b"\0") == bytes((0x7F, 0x36, SUSPENDED))
    assert bench.state().state == "IDLE"


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


def test_map_is_what_the_sensor_read(bench: NodeBench) -> None:
    bench.print_layer(np.eye(9, 8), 1)
    assert bench.scan(1) == DONE
    found, valid = heights(bench.upload(1), 1e-7)
    assert valid.all()
    np.testing.assert_array_equal(found, np.rint(bench.surface / 1e-7) * 1e-7)


@pytest.mark.parametrize("room", [64, 100, 4095])
def test_map_is_the_same_in_blocks_of_any_size(bench: NodeBench, room: int) -> None:
    assert bench.scan(0) == DONE
    assert bench.upload(0, block=room) == bench.upload(0)


def test_block_of_a_map_may_be_asked_for_again(bench: NodeBench) -> None:
    assert bench.scan(0) == DONE
    size = int.from_bytes(bench.raw(b"\x22\x01\x03", PROFILER)[3:7], "big")
    bench.raw(pack(">BBBII", 0x35, 0, 0x44, 0, size), PROFILER)
    first = bench.raw(b"\x36\x01", PROFILER, 100)
    assert bench.raw(b"\x36\x01", PROFILER, 100) == first
    second = bench.raw(b"\x36\x02", PROFILER, 100)
    assert second[2:] != first[2:] or len(second) != len(first)
    assert bench.raw(b"\x36\x01", PROFILER, 100) == bytes((0x7F, 0x36, COUNTER))


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
    blob = pattern_blob(np.ones((9, 8)))
    bench.raw(begin(len(blob), layer=1))
    assert progress.unpack(bench.raw(b"\x22\x01\x04")[3:]) == (1, 1, 1, 7, 0, len(blob))
    for _ in range(2):
        bench.raw(b"\x36\x01" + blob[:10])
        assert progress.unpack(bench.raw(b"\x22\x01\x04")[3:]) == (1, 2, 1, 7, 10, len(blob))
    assert bench.scan(0) == DONE
    bench.raw(pack(">BBBII", 0x35, 0, 0x44, 0, 165), PROFILER)
    bench.raw(b"\x36\x01", PROFILER, 100)
    assert progress.unpack(bench.raw(b"\x22\x01\x04", PROFILER)[3:]) == (3, 2, 0, 7, 98, 165)


def test_map_marks_invalid_cells_and_stands_on_a_datum_when_the_part_is_tall() -> None:
    with NodeBench(dropout_rate=0.3, sensor_seed=4) as bench:
        bench.ready()
        bench.surface[:] = 5e-3 + 1e-6 * np.arange(72).reshape(9, 8)
        assert bench.scan(0) == DONE
        blob = bench.upload(0)
        found, valid = heights(blob, 1e-7)
        assert 0 < valid.sum() < 72
        np.testing.assert_allclose(found[valid], bench.surface[valid], atol=0.51e-7)
        assert not np.frombuffer(blob, ">i2", 72, 12)[~valid.ravel()].any()


def test_all_heights_are_in_a_map_that_spans_as_much_as_16_bits_hold() -> None:
    with NodeBench() as bench:
        bench.ready()
        bench.surface[:] = np.linspace(0.0, 6.5e-3, 72).reshape(9, 8)
        assert bench.scan(0) == DONE
        found, valid = heights(bench.upload(0), 1e-7)
        assert valid.all()
        np.testing.assert_allclose(found, bench.surface, atol=0.51e-7)


def test_height_beyond_16_bits_around_the_datum_is_not_valid(bench: NodeBench) -> None:
    """Never a wrong height: steps of 0.1 um, 7 mm between the lowest cell and the highest."""
    bench.surface[:] = 3.5e-3
    bench.surface[0, 0], bench.surface[8, 7] = 0.0, 7e-3
    assert bench.scan(0) == DONE
    height, valid = heights(bench.upload(0), 1e-7)
    assert np.argwhere(~valid).tolist() == [[0, 0], [8, 7]]
    np.testing.assert_allclose(height[valid], 3.5e-3, rtol=1e-9)


def test_map_before_any_scan_or_of_another_layer_is_refused(bench: NodeBench) -> None:
    request = pack(">BBBII", 0x35, 0, 0x44, 0, 165)
    assert bench.raw(request, PROFILER) == bytes((0x7F, 0x35, SEQUENCE))
    assert bench.scan(0) == DONE
    assert bench.raw(request, PROFILER)[0] == 0x75
    assert bench.raw(pack(">BBBII", 0x35, 0, 0x44, 1, 165), PROFILER) == bytes((0x7F, 0x35, SEQUENCE))
    assert bench.raw(pack(">BBBII", 0x35, 0, 0x44, 0, 164), PROFILER) == bytes((0x7F, 0x35, RANGE))


def test_large_map_is_whole() -> None:
    with NodeBench(nx=300, ny=200, noise_std=1e-6) as bench:
        bench.ready()
        assert bench.scan(0) == DONE
        found, valid = heights(bench.upload(0), 1e-7)
        assert valid.all()
        assert found.std() == pytest.approx(1e-6, rel=0.02, abs=0.0)


def test_session_and_tester_present_answer_as_iso_14229_requires(bench: NodeBench) -> None:
    assert bench.raw(b"\x10\x03", HEAD) == bytes.fromhex("500303E801F4")
    assert bench.raw(b"\x3e\x00") == b"\x7e\x00"
    assert bench.raw(b"\x3e\x80") == bench.raw(b"\x10\x83") == b""
    assert bench.raw(b"\x3e\x01") == b"\x7f\x3e\x12"
    assert bench.raw(b"\x99") == b"\x7f\x99\x11"
    assert bench.raw(b"\x22\x99\x99") == b"\x7f\x22\x31"


@pytest.mark.parametrize(("size", "accepted"), [(8, False), (9, True), (44, True), (45, False)])
def test_size_of_a_pattern_has_limits(bench: NodeBench, size: int, accepted: bool) -> None:
    """More than its head, and at most twice the 18 bytes of the grid beside it."""
    answer = bench.raw(begin(size, layer=1))
    assert answer[0] == 0x74 if accepted else answer == bytes((0x7F, 0x34, RANGE))


def test_reserved_byte_of_a_pattern_is_zero(bench: NodeBench) -> None:
    blob = bytearray(pattern_blob(np.ones((9, 8))))
    blob[7] = 1
    assert bench.download(bytes(blob), 1) == -RANGE


def test_map_is_given_in_its_plain_form_only(bench: NodeBench) -> None:
    assert bench.scan(0) == DONE
    size = bench.raw(b"\x22\x01\x03", PROFILER)[3:7]
    asked = [bytes([0x35, form, 0x44]) + bytes(4) + size for form in (0x10, 0)]
    assert bench.raw(asked[0], PROFILER) == bytes((0x7F, 0x35, RANGE))
    assert bench.raw(asked[1], PROFILER)[0] == 0x75


def test_map_of_an_earlier_layer_is_refused(bench: NodeBench) -> None:
    assert bench.scan(0) == DONE
    assert bench.scan(1) == DONE
    assert bench.raw(pack(">BBBII", 0x35, 0, 0x44, 0, 165), PROFILER) == bytes((0x7F, 0x35, SEQUENCE))
    assert bench.raw(pack(">BBBII", 0x35, 0, 0x44, 1, 165), PROFILER)[0] == 0x75


def test_pattern_whose_successor_is_given_up_is_gone(bench: NodeBench) -> None:
    blob = pattern_blob(np.ones((9, 8)))
    assert bench.download(blob, 1) == 0
    assert bench.state().state == "VERIFIED"
    assert bench.download(blob, 1, crc=1) < 0
    assert (bench.state().state, bench.state().pattern_loaded) == ("IDLE", False)


@pytest.mark.parametrize("shape", [(9, 7), (8, 8), (8, 9)])
def test_pattern_of_another_grid_is_not_jetted(bench: NodeBench, shape: tuple[int, int]) -> None:
    assert bench.download(pattern_blob(np.ones(shape), passes=1), 1) == 0
    assert bench.jet(1, colour=255) < 0
    assert not bench.surface.any()


def test_map_far_below_the_datum_is_whole(bench: NodeBench) -> None:
    bench.surface[:] = -5e-3 + 1e-6 * np.arange(72).reshape(9, 8)
    assert bench.scan(0) == DONE
    found, valid = heights(bench.upload(0), 1e-7)
    assert valid.all()
    np.testing.assert_allclose(found, bench.surface, atol=0.51e-7)
