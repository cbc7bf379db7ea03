"""Bytes of templates, patterns and height maps for a mapped rig, by its mapping file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap, FloatMap
from inkloop.limits import filled
from inkloop_hardware.errors import TransferError
from inkloop_hardware.mapped.mapping_tables import CELLS, METRES, MapTable, PatternTable

FIELDS = ("job", "layer", "nx", "ny")
"""Fields of templates."""


def number(template: int | str, fields: Mapping[str, int]) -> int:
    """A number, or the value of a template such as "{layer}". Raises ValueError for anything else."""
    try:
        return template if isinstance(template, int) else int(filled(template, fields), 0)
    except ValueError as error:
        raise ValueError(f"{template!r}; expected a number or a template of one with {_known()}") from error


def hexadecimal(template: str, fields: Mapping[str, int]) -> bytes:
    """The bytes of a template such as "01 {layer:04x}". Raises ValueError for an invalid one."""
    try:
        return bytes.fromhex(filled(template, fields))
    except ValueError as error:
        raise ValueError(
            f"{template!r}; expected pairs of hexadecimal digits and fields such as {{layer:04x}}, of {_known()}"
        ) from error


def pattern_bytes(pattern: NDArray[Any], table: PatternTable, fields: Mapping[str, int]) -> bytes:
    """Header and cells of a pattern (nx, ny). Raises ValueError for a material that the bits do not hold."""
    highest = int(pattern.max(initial=0))
    if highest >= 1 << table.bits or int(pattern.min(initial=0)) < 0:
        raise ValueError(f"the pattern has material {highest}, too much for {table.bits} bit per cell; set bits = 2")
    lines = np.ascontiguousarray(pattern if table.fastest == "y" else pattern.T).astype(np.uint8)
    places = np.arange(table.bits) if table.bit_order == "lsb" else np.arange(table.bits)[::-1]
    bits = (lines[..., np.newaxis] >> places.astype(np.uint8)) & 1
    flat = bits.reshape(lines.shape[0], -1) if table.whole_lines else bits.reshape(1, -1)
    packed = np.packbits(flat, axis=1, bitorder="little" if table.bit_order == "lsb" else "big")
    return hexadecimal(table.header, fields) + packed.tobytes()


def map_size(table: MapTable, fields: Mapping[str, int]) -> int:
    """Bytes of a map."""
    cells = fields["nx"] * fields["ny"]
    marks = (cells + 7) // 8 if table.valid_bits else 0
    return len(hexadecimal(table.header, fields)) + cells * _dtype(table).itemsize + marks


def read_map(data: bytes, table: MapTable, fields: Mapping[str, int]) -> tuple[FloatMap, BoolMap]:
    """Heights (nx, ny) [m], 0 where not valid, and the valid cells. Raises TransferError for other bytes."""
    header, expected = hexadecimal(table.header, fields), map_size(table, fields)
    if len(data) != expected:
        raise TransferError(f"the map has {len(data)} bytes, expected {expected}; compare [map] with the device")
    if not data.startswith(header):
        found = data[: len(header)].hex(" ")
        raise TransferError(f"the map begins with {found}, expected {header.hex(' ')}; compare [map] with the device")
    nx, ny = fields["nx"], fields["ny"]
    readings = np.frombuffer(data, _dtype(table), nx * ny, len(header))
    valid = np.isfinite(readings)
    if table.invalid is not None:
        valid &= readings != table.invalid
    if table.valid_bits:
        marks = np.frombuffer(data, np.uint8, offset=len(header) + readings.nbytes)
        valid &= np.unpackbits(marks, count=nx * ny).astype(np.bool_)
    with np.errstate(invalid="ignore"):
        heights = (readings.astype(np.float64) * table.scale + table.datum) * METRES[table.unit]
    shape = (nx, ny) if table.fastest == "y" else (ny, nx)
    laid = [
        np.ascontiguousarray(flat.reshape(shape) if table.fastest == "y" else flat.reshape(shape).T)
        for flat in (np.where(valid, heights, 0.0), valid)
    ]
    return laid[0], laid[1]


def _dtype(table: MapTable) -> np.dtype[Any]:
    return np.dtype((">" if table.byte_order == "big" else "<") + CELLS[table.cell])


def _known() -> str:
    return ", ".join(f"{{{name}}}" for name in FIELDS)
