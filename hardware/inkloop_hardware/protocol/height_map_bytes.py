"""Bytes of a height map on the bus: signed 16-bit steps relative to a datum, and one bit per valid cell.

The bytes are described on the page of the node's services; the C side is `height_map.c`.
"""

from __future__ import annotations

import struct

import numpy as np

from inkloop.component import BoolMap, FloatMap
from inkloop.units import NM_PER_M
from inkloop_hardware.errors import FrameError

VERSION = 1
_HEAD = struct.Struct(">BBHHHi")  # version, 0, nx, ny, nanometres per step, datum in steps


def map_size(nx: int, ny: int) -> int:
    """Bytes of the map of a grid."""
    cells = nx * ny
    return _HEAD.size + 2 * cells + (cells + 7) // 8


def read_map(blob: bytes, nx: int, ny: int) -> tuple[FloatMap, BoolMap]:
    """Heights [m], (nx, ny), and which of them are valid; a cell that is not has height 0.

    FrameError for bytes that are no map, or the map of another grid.
    """
    if len(blob) < _HEAD.size:
        raise FrameError(f"a height map of {len(blob)} bytes; its head alone has {_HEAD.size}")
    version, _, found_nx, found_ny, nanometres, datum = _HEAD.unpack_from(blob)
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
    readings = np.frombuffer(blob, ">i2", cells, _HEAD.size).astype(np.int64) + datum
    bits = np.frombuffer(blob, np.uint8, offset=_HEAD.size + 2 * cells)
    valid = np.unpackbits(bits, count=cells).astype(np.bool_).reshape(nx, ny)
    step = nanometres / NM_PER_M  # a quotient: the double nearest to the step, as a sensor's parameter is
    return np.where(valid, readings.reshape(nx, ny) * step, 0.0), valid
