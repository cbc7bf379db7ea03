"""STL and OBJ: one body; what a file has that its format does not know is an error with its line."""

from __future__ import annotations

import re
from array import array
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from inkloop.errors import GeometryError
from inkloop.geometry.body import Body

_HEADER = 84
"""Bytes before the triangles of binary STL; the last four are their number."""
_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_BLANKS = b"\0 \t\r\n\f\v"
_FACET = b"facet normal # # # outer loop vertex x y z vertex x y z vertex x y z endloop endfacet".split()
"""The words of a facet; x, y, z are numbers, and # is not read."""
_KEYWORDS = {n: word for n, word in enumerate(_FACET) if len(word) > 1}
_CORNERS = [n for n, word in enumerate(_FACET) if word in b"xyz"]
_NAMES = re.compile(rb"^[ \t]*(?:end[ \t]*)?solid[^\n]*", re.MULTILINE)
_ELEMENTS = {
    b"v": "three numbers",
    b"f": "three vertices or more, counted from 1, or back from -1",
    b"surf": "faces of vertices; free-form surfaces are not read",
}
_SHOWN = 3


def read_stl(path: Path) -> tuple[list[Body], None]:
    """Binary where its number of triangles agrees with the length, whatever the header says; else text.

    Less than a triangle, or any number of blanks, may follow; texts may begin with a mark of UTF-8.
    """
    data = path.read_bytes()
    count = int.from_bytes(data[_HEADER - 4 : _HEADER], "little")
    end = _HEADER + count * _RECORD.itemsize
    if end <= len(data) and (len(data) < end + _RECORD.itemsize or not data[end:].strip(_BLANKS)):
        records = np.frombuffer(data, _RECORD, count, _HEADER)
        return [Body(records["corners"].astype(np.float64), path.stem)], None
    text = data.removeprefix(b"\xef\xbb\xbf").rstrip(_BLANKS)
    _check_text(path, data, text, count)
    return [Body(_text_triangles(path, text), path.stem)], None


def _check_text(path: Path, data: bytes, text: bytes, count: int) -> None:
    """Raises GeometryError for a file that is neither text nor binary of the right length."""
    begins_as_text = text.lstrip()[:5].lower() == b"solid"
    if begins_as_text and b"\0" not in text:
        return
    if len(data) < _HEADER:
        found = f"has {len(data)} bytes" if data else "is empty"
        raise GeometryError(
            f"{path}: {found}; expected 'solid', as text STL begins, or binary STL of {_HEADER} bytes at least; "
            "save it again"
        )
    expected = _HEADER + count * _RECORD.itemsize
    found = "begins with 'solid' as text STL does, but is binary, and" if begins_as_text else "is binary STL that"
    raise GeometryError(
        f"{path}: {found} states {count:,} triangles in its header, {expected:,} bytes; it has {len(data):,}; "
        "the file is cut off, damaged or no STL: save it again"
    )


def _text_triangles(path: Path, text: bytes) -> NDArray[np.float64]:
    """Triangles of all solids in a text, in either case of letters. Raises GeometryError."""
    text = _NAMES.sub(b"", text.lower().replace(b"\r\n", b"\n").replace(b"\r", b"\n"))
    words = text.split()
    count, rest = divmod(len(words), len(_FACET))
    try:
        if rest or b"_" in text or any(words[n :: len(_FACET)] != [word] * count for n, word in _KEYWORDS.items()):
            raise ValueError
        corners = [np.fromiter(map(float, words[n :: len(_FACET)]), np.float64, count) for n in _CORNERS]
    except ValueError as error:
        raise GeometryError(f"{path}: {_fault(text)}: the file is cut off or damaged, save it again") from error
    return np.stack(corners, axis=-1).reshape(-1, 3, 3)


def _fault(text: bytes) -> str:
    """The first word that does not belong where it is."""
    count = 0
    for found in re.finditer(rb"\S+", text):
        at, word = count % len(_FACET), found[0]
        expected = "a number" if at in _CORNERS else repr(_FACET[at].decode())
        if not (_is_number(word) if at in _CORNERS else word == _KEYWORDS.get(at, word)):
            line = 1 + text.count(b"\n", 0, found.start())
            return f"line {line}: found {word.decode(errors='replace')!r}, expected {expected}"
        count += 1
    return f"ends within facet {count // len(_FACET) + 1:,}"


def _is_number(word: bytes) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return b"_" not in word


def read_obj(path: Path) -> tuple[list[Body], None]:
    """All objects as one body; polygons become fans of triangles. Materials are not read. Raises GeometryError."""
    vertices, fans, lines, faults = array("d"), array("q"), array("q"), list[str]()
    begun = b""
    for number, line in enumerate(path.read_bytes().splitlines(), 1):
        if line.endswith(b"\\"):
            begun += line[:-1] + b" "
            continue
        line, begun = begun + line, b""
        keyword, *words = line.split() or (b"",)
        try:
            if keyword in _ELEMENTS and b"_" in line:
                raise ValueError
            if keyword == b"v":
                x, y, z = map(float, words[:3])
                vertices.extend((x, y, z))
            elif keyword == b"f":
                first, second, third, *others = [_index(word, len(vertices) // 3) for word in words]
                for one, other in pairwise((second, third, *others)):
                    fans.extend((first, one, other))
                    lines.append(number)
            elif keyword == b"surf":
                raise ValueError
        except ValueError:
            found = line.strip().decode(errors="replace")
            faults.append(f"line {number}: found {found!r}, expected {_ELEMENTS[keyword]}")
    indices, count = np.array(fans, np.int64).reshape(-1, 3), len(vertices) // 3
    for n in np.flatnonzero(indices.max(axis=1, initial=-1) >= count):
        faults.append(f"line {lines[n]}: found a face of vertex {indices[n].max() + 1}, expected 1 to {count}")
    if faults:
        more = f"; and {len(faults) - _SHOWN:,} more" if len(faults) > _SHOWN else ""
        raise GeometryError(f"{path}: {'; '.join(faults[:_SHOWN])}{more}; save it again")
    return [Body(np.array(vertices).reshape(-1, 3)[indices], path.stem)], None


def _index(word: bytes, count: int) -> int:
    """Number of a corner's vertex, from 0; count: vertices so far. Raises ValueError."""
    index = int(word.partition(b"/")[0])
    if not -count <= index != 0:
        raise ValueError
    return index - 1 if index > 0 else count + index
