"""The file of an exported FMU with its parameters: resources/job.bin, resources/bench.bin."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.fmu_writer.definition import ModelDefinition

MAGIC = b"InkJob\r\n"
LAYOUT = 1


@dataclass(frozen=True, eq=False)
class Section:
    """The parameters of one model that are not its start values: in SI, maps (nx, ny), enumerations as numbers.

    A string is its bytes.
    """

    model: ModelDefinition
    values: Mapping[str, NDArray[Any]]


def to_bytes(nx: int, ny: int, sections: Sequence[Section]) -> bytes:
    """The content of the file, as fmus/common/parameter_file.c reads it: all numbers little-endian."""
    checked = struct.pack("<QQ", nx, ny) + b"".join(_section_bytes(section) for section in sections)
    return MAGIC + struct.pack("<II", LAYOUT, zlib.crc32(checked)) + checked


def check_sum(content: bytes) -> str:
    """Identifies this file, 8 hexadecimal digits; the token of its FMU ends with it."""
    return f"{struct.unpack_from('<I', content, 12)[0]:08x}"


def _section_bytes(section: Section) -> bytes:
    numbers = {variable.name: number for number, variable in enumerate(section.model.variables)}
    head = struct.pack("<32s16sQ", section.model.name.encode(), section.model.fingerprint.encode(), len(section.values))
    return head + b"".join(_parameter(numbers[name], value) for name, value in section.values.items())


def _parameter(number: int, value: NDArray[Any]) -> bytes:
    return struct.pack("<QQ", number, value.size) + np.ascontiguousarray(value, "<f8").tobytes()
