"""Bytes of patterns and height maps on the bus.

A pattern is a head, then packed cells, run-length coded if that is shorter. A map is a head, signed 16-bit steps
relative to a datum, and one bit per valid cell. The page of the node's services describes both; the C side is
`pattern.c` and `height_map.c`.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap, FloatMap
from inkloop.units import NM_PER_M
from inkloop_hardware.errors import FrameError

VERSION = 1
CELLS_MAX = 1_000_000
_PATTERN_HEAD = struct.Struct(">BBHHBB")  # version, bits per cell, nx, ny, passes, 0
_RUN_MIN, _RUN_MAX, _LITERAL_MAX, _RUN_OFFSET = 3, 129, 128, 126


@dataclass(frozen=True)
class PatternBytes:
    """One layer's pattern in both forms: `plain` is packed, `coded` the same with its cells run-length coded."""

    plain: bytes
    coded: bytes

    @classmethod
    def of(cls, pattern: NDArray[Any], *, passes: int, materials: int) -> PatternBytes:
        """Bytes of a pattern (nx, ny): 0 none, 1 material A, 2 material B. ValueError for a pattern that the bus cannot
        carry.

        One bit a cell for one material, two for two; first index slowest, most significant bit first.
        """
        values = np.asarray(pattern)
        _check(values, materials)
        bits = 1 if materials == 1 else 2
        planes = (values.astype(np.uint8).ravel()[:, None] >> np.arange(bits - 1, -1, -1)) & 1
        head = _PATTERN_HEAD.pack(VERSION, bits, *values.shape, passes, 0)
        cells = np.packbits(planes.ravel().astype(np.uint8))
        return cls(head + cells.tobytes(), head + run_length(cells))

    @staticmethod
    def cells_of(nx: int, ny: int, *, materials: int) -> int:
        """Bytes of the packed cells of a grid."""
        return (nx * ny * (1 if materials == 1 else 2) + 7) // 8

    @property
    def is_shorter_coded(self) -> bool:
        """Whether the run-length coded form has fewer bytes."""
        return len(self.coded) < len(self.plain)

    def form_of(self, crc: int) -> bool | None:
        """Whether a CRC-32 is that of the coded form (True) or of the plain one (False); None for another pattern."""
        return {zlib.crc32(self.coded): True, zlib.crc32(self.plain): False}.get(crc)


def run_length(cells: NDArray[np.uint8]) -> bytes:
    """Packed cells with runs of three and more coded as runs.

    A byte c < 128 precedes c + 1 literal bytes, any other one byte that is repeated c - 126 times.
    """
    if cells.size == 0:
        return b""
    starts = np.concatenate([[0], np.flatnonzero(cells[1:] != cells[:-1]) + 1])
    lengths = np.diff(np.append(starts, cells.size))
    long = lengths >= _RUN_MIN
    plain, coded, at = cells.tobytes(), bytearray(), 0
    for start, length in zip(starts[long].tolist(), lengths[long].tolist(), strict=True):
        for part in _pieces(plain, at, start):
            coded += part
        whole, rest = divmod(length, _RUN_MAX)
        coded += bytes([_RUN_MAX + _RUN_OFFSET, plain[start]]) * whole
        if rest >= _RUN_MIN - 1:
            coded += bytes([rest + _RUN_OFFSET, plain[start]])
            rest = 0
        at = start + length - rest
    for part in _pieces(plain, at, len(plain)):
        coded += part
    return bytes(coded)


def packed(coded: bytes) -> bytes:
    """Packed cells of run-length coded ones; an incomplete run at the end is left out."""
    cells, at = bytearray(), 0
    while at + 1 < len(coded):
        count = coded[at]
        if count < _LITERAL_MAX:
            cells += coded[at + 1 : at + 2 + count]
            at += 2 + count
        else:
            cells += coded[at + 1 : at + 2] * (count - _RUN_OFFSET)
            at += 2
    return bytes(cells)


def first_difference(left: bytes, right: bytes) -> tuple[int, int] | None:
    """The first cell (i, j) in which the plain bytes of two patterns differ; None if they do not, or in their heads."""
    if left[: _PATTERN_HEAD.size] != right[: _PATTERN_HEAD.size] or len(left) < _PATTERN_HEAD.size:
        return None
    bits, ny = left[1], int.from_bytes(left[4:6], "big")
    pairs = zip(left[_PATTERN_HEAD.size :], right[_PATTERN_HEAD.size :], strict=False)
    for at, (one, other) in enumerate(pairs):
        if one != other:
            bit = 8 * at + 8 - (one ^ other).bit_length()
            return divmod(bit // bits, ny)
    return None


def plain_form(blob: bytes, coded: bool) -> bytes:
    """The plain bytes of a pattern in either form."""
    return blob[: _PATTERN_HEAD.size] + packed(blob[_PATTERN_HEAD.size :]) if coded else blob


def _pieces(plain: bytes, first: int, end: int) -> Iterator[bytes]:
    for at in range(first, end, _LITERAL_MAX):
        piece = plain[at : min(end, at + _LITERAL_MAX)]
        yield bytes([len(piece) - 1]) + piece


def _check(values: NDArray[Any], materials: int) -> None:
    if values.ndim != 2 or not 0 < values.size <= CELLS_MAX:
        raise ValueError(
            f"a pattern of {values.shape} cells; the bus carries two dimensions and up to {CELLS_MAX} cells"
        )
    if materials not in (1, 2):
        raise ValueError(f"{materials} materials; a pattern on the bus knows 1 or 2")
    low, high = int(values.min()), int(values.max())
    if low < 0 or high > materials:
        raise ValueError(f"a pattern with values from {low} to {high}; the head jets 0 to {materials}")


_MAP_HEAD = struct.Struct(">BBHHHi")  # version, 0, nx, ny, nanometres per step, datum in steps


def map_size(nx: int, ny: int) -> int:
    """Bytes of the map of a grid."""
    cells = nx * ny
    return _MAP_HEAD.size + 2 * cells + (cells + 7) // 8


def read_map(blob: bytes, nx: int, ny: int) -> tuple[FloatMap, BoolMap]:
    """Heights [m], (nx, ny), and which of them are valid; a cell that is not has height 0.

    FrameError for bytes that are no map, or the map of another grid.
    """
    if len(blob) < _MAP_HEAD.size:
        raise FrameError(f"a height map of {len(blob)} bytes; its head alone has {_MAP_HEAD.size}")
    version, _, found_nx, found_ny, nanometres, datum = _MAP_HEAD.unpack_from(blob)
    if version != VERSION:
        raise FrameError(f"a height map of version {version}; this inkloop reads {VERSION}; update the older side")
    if (found_nx, found_ny) != (nx, ny):
        raise FrameError(
            f"a height map of {found_nx} x {found_ny} cells; the scenario has {nx} x {ny}: set the profiler to the "
            "scenario's grid, or grid.nx and grid.ny to what it measures"
        )
    if len(blob) != map_size(nx, ny) or nanometres == 0:
        raise FrameError(
            f"a height map of {len(blob)} bytes in steps of {nanometres} nm; {nx} x {ny} cells take "
            f"{map_size(nx, ny)} bytes and steps of at least 1 nm"
        )
    cells = nx * ny
    readings = np.frombuffer(blob, ">i2", cells, _MAP_HEAD.size).astype(np.int64) + datum
    bits = np.frombuffer(blob, np.uint8, offset=_MAP_HEAD.size + 2 * cells)
    valid = np.unpackbits(bits, count=cells).astype(np.bool_).reshape(nx, ny)
    step = nanometres / NM_PER_M  # a quotient: the double nearest to the step, as a sensor's parameter is
    return np.where(valid, readings.reshape(nx, ny) * step, 0.0), valid
