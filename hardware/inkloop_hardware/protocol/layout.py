"""Layouts of the bytes of records: a field `Annotated[T, n]` of a data class takes n bytes, big-endian.

T is an int, or an IntEnum or IntFlag, which is its value; a float is a time in s, and milliseconds on the wire.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from struct import Struct
from typing import Any, NamedTuple, TypeVar, get_type_hints

from inkloop.units import MS_PER_S

CODES = {1: "B", 2: "H", 4: "I"}

Record = TypeVar("Record")


class Part(NamedTuple):
    """A number in a message: its name, its type as above, its bytes."""

    name: str
    type: Any
    size: int


@lru_cache
def parts(record: Any) -> tuple[Part, ...]:
    """The fields of a class of records in the order of their bytes."""
    hints = get_type_hints(record, include_extras=True)
    return tuple(Part(name, hint.__origin__, *hint.__metadata__) for name, hint in hints.items())


def size(record: Any) -> int:
    """Bytes of a record."""
    return _struct(record).size


def pack(record: Any) -> bytes:
    """The bytes of a record."""
    kind: Any = type(record)
    pairs = ((part.type, getattr(record, part.name)) for part in parts(kind))
    return _struct(kind).pack(*(round(value * MS_PER_S) if type_ is float else value for type_, value in pairs))


def unpack(record: Callable[..., Record], data: bytes) -> Record:
    """The record in these bytes; struct.error for another number of them, ValueError for an unknown value."""
    pairs = zip(parts(record), _struct(record).unpack(data), strict=True)
    return record(*(number / MS_PER_S if part.type is float else part.type(number) for part, number in pairs))


@lru_cache
def _struct(record: Any) -> Struct:
    return Struct(">" + "".join(CODES[part.size] for part in parts(record)))
