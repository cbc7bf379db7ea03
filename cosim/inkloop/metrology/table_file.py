"""Height maps in text: rows of numbers under lines of header, as profilers and spreadsheets export them.

Of the header are understood `key = 5 um`, `key [um]; 5`, `key_um, 5` and `"key","5","um"`, with or without a leading #,
and "Height [um]" alone. Other lines are skipped.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from inkloop.component import FloatMap
from inkloop.errors import HeightMapError
from inkloop.metrology.map_readers import FileContents, length_factor, pixel_of

_WORDS = ("NAN", "BAD", "N/A", "NA", "INVALID", "NULL", "NONE", "***", "---", "--")
"""Entries that programs write for missing measurements."""
_NUMBER = r"[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?"
_FIELD = re.compile(rf"\s*(?:{_NUMBER}|{'|'.join(map(re.escape, _WORDS))}|[+-]?inf)?\s*", re.IGNORECASE)
_POINT_COLUMNS = 3
"""A list of points has a column for x, y and z each."""
_UNIT = r"(?:nm|um|\u00b5m|\u03bcm|mm|pm|m)"
_LINE = re.compile(
    rf"""^[\s\#"']*
    (?P<key>[A-Za-z][A-Za-z .\-/]*?(?:_[xy])?)
    (?:_(?P<suffix>{_UNIT}))?
    \s*(?:[\[(]\s*(?P<bracket>{_UNIT})(?:\s*/\s*(?:px|pixel|pix))?\s*[\])])?
    (?P<between>[\s"'=:;,\t]*)
    (?P<number>[+-]?\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?)?
    [\s"';,\t]*
    (?:[\[(]?\s*(?P<after>{_UNIT})(?:\s*/\s*(?:px|pixel|pix))?\s*[\])]?)?
    [\s"';,\t]*$""",
    re.VERBOSE,
)
_HEIGHTS = {"height", "heights", "surface", "topography", "unit", "units", "z"}
_HEIGHTS |= {"height unit", "unit z", "value unit", "value units", "z unit", "z units"}
_STEPS = {
    "both": {"pixel", "pixel size", "pixel pitch", "pixel spacing", "xy calibration", "spacing", "step", "sampling"},
    "dx": {"dx", "x step", "step x", "x spacing", "x pixel size", "pixel size x", "pixel width", "x pixel", "pixel_x"},
    "dy": {"dy", "y step", "step y", "y spacing", "y pixel size", "pixel size y", "pixel height", "y pixel", "pixel_y"},
}
_FIELDS = {
    "dx": {"width", "field width", "x size", "size x"},
    "dy": {"height", "field height", "y size", "size y"},
}


def read_table(path: Path) -> FileContents:
    """A table separated by semicolons, tabs, commas or spaces; row 0 is the first row along y.

    Decimal point or comma, as the table has it. An empty field, BAD, NaN, --- ... is a pixel without a height. The
    header may state the unit of the heights and the pixel size. Raises HeightMapError, OSError.
    """
    lines = _decoded(path.read_bytes()).splitlines()
    first, separator = _first_row(path, lines)
    values = _numbers(path, lines[first:], separator, first + 1)
    if values.shape[1] == _POINT_COLUMNS < values.shape[0]:
        raise HeightMapError(
            f"{path}: has {values.shape[0]} rows of 3 columns, which looks like a list of points x, y, z; "
            "save the map as a matrix of heights"
        )
    unit, pixel = read_header(lines[:first], values.shape[1], values.shape[0])
    return FileContents(values, unit, pixel)


def read_header(lines: Sequence[str], columns: int, rows: int) -> tuple[str | None, tuple[float, float] | None]:
    """Unit of the heights and pixel size (dx, dy) [m] from the lines; None if missing.

    columns, rows: size of the table, for files that state how wide and high the field is.
    """
    unit: str | None = None
    sizes: dict[str, float] = {}
    for found in filter(None, map(_LINE.match, lines)):
        key = " ".join(found["key"].lower().split())
        stated = found["suffix"] or found["bracket"] or found["after"]
        factor = length_factor(stated) if stated else None
        if factor is None:
            continue
        if found["number"] is None:
            unit = stated if key in _HEIGHTS else unit
            continue
        length = float(found["number"].replace(",", ".")) * factor
        sizes |= {name: length for name, keys in _STEPS.items() if key in keys}
        sizes |= {name: length / {"dx": columns, "dy": rows}[name] for name, keys in _FIELDS.items() if key in keys}
    return unit, pixel_of(sizes)


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
