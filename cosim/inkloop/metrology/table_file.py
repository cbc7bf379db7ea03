"""Height maps and profiles in text: rows of numbers under a header, as profilers and spreadsheets export them."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import isclose, prod
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap
from inkloop.errors import HeightMapError
from inkloop.metrology.map_readers import PIXEL_TOLERANCE, FileContents, length_factor
from inkloop.metrology.table_header import NUMBER, Header, read_header
from inkloop.units import UM_PER_M

_WORDS = ("NAN", "BAD", "N/A", "NA", "INVALID", "NULL", "NONE", "***", "---", "--")
"""Entries that programs write for missing measurements."""
_FIELD = re.compile(rf"\s*(?:{NUMBER}|{'|'.join(map(re.escape, _WORDS))}|[+-]?inf)?\s*", re.IGNORECASE)
_UNEVEN = 0.1
"""Share of a step by which rounded places may be off."""


def read_table(path: Path) -> FileContents:
    """A table separated by semicolons, tabs, commas or spaces; row 0 is the first row along y.

    Decimal point or comma, as the table has it. An empty field, BAD, NaN, --- ... is a pixel without a height. The
    header may state the unit of the heights and the pixel size. Two columns of which the first one rises or falls are a
    profile x, z; three columns are a list of points x, y, z, in any order, if the header states their grid. Raises
    HeightMapError, OSError.
    """
    lines = _decoded(path.read_bytes()).splitlines()
    first, separator = _first_row(path, lines)
    values = _numbers(path, lines[first:], separator, first + 1)
    header, (rows, columns) = read_header(lines[:first]), values.shape
    _check_rows(path, lines[:first], separator, columns, rows)
    if header.counts != {"dx": columns, "dy": rows} and columns < rows:
        if columns == len("xz") and _is_monotonic(values[:, 0]):
            return _listed(path, values, header, "x")
        if columns == len("xyz"):
            return _listed(path, values, header, "xy")
    stated = header.counts.get("dx", columns) * header.counts.get("dy", rows)
    if stated != values.size:
        raise HeightMapError(
            f"{path}: has {rows} rows of {columns} heights, its header states {stated:,} heights; it may be cut off"
        )
    return FileContents(values, header.unit, header.pixel(columns, rows), invalid=header.invalid)


def _check_rows(path: Path, above: Sequence[str], separator: str, columns: int, rows: int) -> None:
    """Raises HeightMapError for a damaged or labelled row above the first one, and for a single row."""
    for number, line in enumerate(above, start=1):
        fields = _split(line, separator)
        wrong = [k for k, field in enumerate(fields) if not _FIELD.fullmatch(field)]
        heights = [field for k, field in enumerate(fields) if k not in wrong and field.strip()]
        if not line.startswith("#") and columns < 2 * len(fields) < 3 * len(heights):
            found = f"line {number}, column {wrong[0] + 1} is {fields[wrong[0]].strip()[:30]!r} among numbers"
            raise HeightMapError(f"{path}: {found}; expected a row of heights without a label, or a # before it")
    if rows == 1:
        raise HeightMapError(f"{path}: has one row of {columns} numbers; a map needs two, the file may be cut off")


def _is_monotonic(values: FloatMap) -> bool:
    return bool((values[1:] > values[:-1]).all() or (values[1:] < values[:-1]).all())


def _listed(path: Path, table: FloatMap, header: Header, axes: str) -> FileContents:
    """A list of places on the axes "x" or "xy" and of heights: a profile, (n,), or a map, (rows, columns)."""
    is_named = len(header.titles) == table.shape[1]
    units = [unit for _, unit in header.titles] if is_named else [None] * table.shape[1]
    if len(axes) > 1 and not (is_named or len(header.counts) == len(axes)):
        raise HeightMapError(
            f"{path}: has {table.shape[0]} rows of 3 columns, which looks like a list of points x, y, z; name them "
            "above the first row as x [mm], y [mm], z [um], state nx and ny there, or save a matrix of heights"
        )
    found = [_places(path, table[:, k], axis, header, units[k]) for k, axis in enumerate(axes)]
    shape = [place.count for place in reversed(found)]
    flat = np.ravel_multi_index([place.index for place in reversed(found)], shape)
    if np.unique(flat).size < len(table) or prod(shape) > 2 * len(table):
        raise HeightMapError(
            f"{path}: lists {len(table):,} points on a grid of {' x '.join(map(str, shape))}; expected each place "
            "once, and at least half of them"
        )
    heights = np.full(shape, np.nan)
    heights.flat[flat] = table[:, -1]
    dx, dy = found[0].size, found[-1].size
    pixel = None if dx is None or dy is None else (dx, dy)
    return FileContents(heights, units[-1] or header.unit, pixel, invalid=header.invalid)


@dataclass(frozen=True, eq=False)
class _Places:
    """count: of different places along an axis; index: (N,), the place of each row; size: their distance [m]."""

    count: int
    index: NDArray[np.intp]
    size: float | None


def _places(path: Path, column: FloatMap, axis: str, header: Header, unit: str | None) -> _Places:
    """The places of a column, which are evenly spaced and as many as the header states. Raises HeightMapError."""
    name, different = f"d{axis}", np.unique(column)
    count, step = different.size, float(different[-1] - different[0]) / max(different.size - 1, 1)
    index = np.rint((column - different[0]) / step) if 0.0 < step < np.inf else column
    if not (0.0 < step < np.inf and np.abs(column - different[0] - index * step).max() <= _UNEVEN * step):
        raise HeightMapError(f"{path}: the steps of its column {axis} are not even; expected the places of a grid")
    if header.counts.get(name, count) != count:
        raise HeightMapError(
            f"{path}: holds {count} places along {axis}, its header states {header.counts[name]}; it may be cut off"
        )
    stated = header.size(name, count)
    size = stated if unit is None else step * (length_factor(unit) or 0.0)
    if stated and size and name in header.steps and not isclose(size, stated, rel_tol=PIXEL_TOLERANCE):
        raise HeightMapError(
            f"{path}: its places along {axis} are {size * UM_PER_M:g} µm apart, its header states "
            f"{stated * UM_PER_M:g} µm; correct one of them"
        )
    return _Places(count, index.astype(np.intp), size)


def _decoded(raw: bytes) -> str:
    """The text; instruments on Windows write code page 1252 or UTF-16."""
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        return raw.decode("utf-16")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("cp1252", errors="replace")


def _first_row(path: Path, lines: Sequence[str]) -> tuple[int, str]:
    """Index of the first row of numbers, and the separator of its fields."""
    for index, line in enumerate(lines):
        separator = _separator(line)
        fields = _split(line, separator)
        if len(fields) > 1 and any(re.search(r"\d", field) for field in fields) and all(map(_FIELD.fullmatch, fields)):
            return index, separator
    raise HeightMapError(
        f"{path}: has no row of numbers (lines read: {len(lines)}); expected heights, separated by ; tab , or spaces"
    )


def _separator(line: str) -> str:
    """The separator of the fields of a line; commas inside numbers are decimal commas."""
    for separator in (";", "\t"):
        if separator in line:
            return separator
    has_spaces = re.search(r"\S\s+\S", line.replace(", ", ",")) is not None
    return "," if "," in line and not has_spaces else " "


def _split(line: str, separator: str) -> list[str]:
    return line.split() if separator == " " else line.split(separator)


def _numbers(path: Path, rows: Sequence[str], separator: str, first_line: int) -> FloatMap:
    """The rows as an array, NaN where a field holds no number. Raises HeightMapError with line and column."""
    import pandas as pd

    if separator != " " and all(row.rstrip(" ").endswith(separator) for row in filter(str.strip, rows)):
        rows = [row.rstrip(" ").removesuffix(separator) for row in rows]
    text = "\n".join(rows)
    if separator != " ":
        text = text.replace(f" {separator}", separator)
    has_commas = separator != "," and "," in text
    if has_commas and "." in text:
        raise HeightMapError(f"{path}: has numbers with , and numbers with . in one table; expected one of them")
    try:
        if len({len(_split(row, separator)) for row in filter(str.strip, rows)}) > 1:
            raise ValueError("rows of several lengths, which pandas would fill up")
        table = pd.read_csv(
            io.StringIO(text),
            sep=r"\s+" if separator == " " else separator,
            decimal="," if has_commas else ".",
            header=None,
            dtype=np.float64,
            na_values=[spelling for word in _WORDS for spelling in (word, word.lower(), word.title(), "NaN", "")],
            keep_default_na=False,
            skipinitialspace=True,
            quoting=csv.QUOTE_NONE,
        )
    except ValueError as error:
        raise HeightMapError(f"{path}: {_place(rows, separator, first_line)}") from error
    return np.asarray(table, np.float64)


def _place(rows: Sequence[str], separator: str, first_line: int) -> str:
    """The first field that is no number, or the first row of another length, as a message."""
    expected = len(_split(rows[0], separator))
    for number, row in enumerate(rows, start=first_line):
        fields = _split(row, separator) if row.strip() else [""] * expected
        for column, field in enumerate(fields, start=1):
            if not _FIELD.fullmatch(field):
                return f"line {number}, column {column} is {field.strip()[:30]!r}; expected a height, or BAD or nothing"
        if len(fields) != expected:
            return f"line {number} has {len(fields)} fields, the rows before it {expected}; the file may be cut off"
    return "holds a number that cannot be read"
