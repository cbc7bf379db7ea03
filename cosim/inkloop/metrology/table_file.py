"""Height maps in text: rows of numbers under lines of header, as profilers and spreadsheets export them."""

from __future__ import annotations

import io
import re
import string
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from inkloop.component import FloatMap
from inkloop.errors import HeightMapError
from inkloop.metrology.file_contents import FileContents
from inkloop.metrology.table_header import read_header

_WORDS = ("NAN", "BAD", "N/A", "NA", "INVALID", "NULL", "NONE", "***", "---", "--")
"""Entries that programs write for missing measurements; NAN before NA, which it begins with."""
_NUMBER = r"[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?"
_FIELD = re.compile(rf"\s*(?:{_NUMBER}|{'|'.join(map(re.escape, _WORDS))}|[+-]?inf)?\s*", re.IGNORECASE)
_POINT_COLUMNS = 3
"""A list of points has a column for x, y and z each."""


def read_table(path: Path) -> FileContents:
    """A table separated by semicolons, tabs, commas or spaces; row 0 is the first row along y.

    Decimal point or comma, as the table has it. An empty field, BAD, NaN, --- ... is a pixel without a height. The
    header may state the unit of the heights and the pixel size, see `table_header`. Raises HeightMapError, OSError.
    """
    lines = _decoded(path.read_bytes()).splitlines()
    first, separator = _first_row(path, lines)
    last = len(lines)
    while last > first and not lines[last - 1].strip():
        last -= 1
    values = _numbers(path, lines[first:last], separator, first + 1)
    if values.shape[1] == _POINT_COLUMNS < values.shape[0]:
        raise HeightMapError(
            f"{path}: has {values.shape[0]} rows of 3 columns, which looks like a list of points x, y, z; "
            "save the map as a matrix of heights"
        )
    unit, pixel = read_header(lines[:first], values.shape[1], values.shape[0])
    return FileContents(values, unit, pixel)


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
    if separator != " " and all(row.rstrip(" ").endswith(separator) for row in rows):
        rows = [row.rstrip(" ").removesuffix(separator) for row in rows]
    text = "\n".join(rows)
    if separator != "," and "," in text:
        if "." in text:
            raise HeightMapError(f"{path}: has numbers with , and numbers with . in one table; expected one of them")
        text = text.replace(",", ".")
    try:
        return _parsed(text, separator)
    except ValueError:
        marked = _marked(text, separator)
    try:
        return _parsed(marked, separator)
    except ValueError as error:
        raise HeightMapError(f"{path}: {_place(marked.split(chr(10)), separator, first_line)}") from error


def _marked(text: str, separator: str) -> str:
    """The rows with nan for words and empty fields; by plain replacement, which is much faster than an expression."""
    text, mark = f"\n{text}\n".replace("\r", ""), "\0"
    if separator != " ":
        text = text.replace(f"{separator} ", separator).replace(f" {separator}", separator)
        for _ in range(2):  # fields share separators, so every other one is found at a time
            text = text.replace(separator * 2, f"{separator}{mark}{separator}")
        text = text.replace(f"\n{separator}", f"\n{mark}{separator}").replace(f"{separator}\n", f"{separator}{mark}\n")
    written = {letter for letter in string.ascii_letters + "*-/" if letter in text}
    for word in _WORDS:
        for spelling in {word, word.lower(), word.title(), "NaN"}:
            if written.issuperset(spelling):
                text = text.replace(f"{separator}{spelling}", f"{separator}{mark}")
                text = text.replace(f"\n{spelling}", f"\n{mark}")
    return text.strip("\n").replace(mark, "nan")


def _parsed(text: str, separator: str) -> FloatMap:
    parsed = np.loadtxt(io.StringIO(text), delimiter=None if separator == " " else separator, ndmin=2, comments=None)
    return np.asarray(parsed, np.float64)


def _place(rows: Sequence[str], separator: str, first_line: int) -> str:
    """The first field that is no number, or the first row of another length, as a message."""
    expected = len(_split(rows[0], separator))
    for number, row in enumerate(rows, start=first_line):
        fields = _split(row, separator)
        for column, field in enumerate(fields, start=1):
            if not re.fullmatch(rf"\s*(?:{_NUMBER}|nan|[+-]?inf)\s*", field, re.IGNORECASE):
                return f"line {number}, column {column} is {field.strip()[:30]!r}; expected a height, or BAD or nothing"
        if len(fields) != expected:
            return f"line {number} has {len(fields)} fields, the rows before it {expected}; the file may be cut off"
    return "holds a number that cannot be read"
