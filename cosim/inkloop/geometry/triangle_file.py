"""STL, OBJ and PLY: one body, read by trimesh; content that its readers silently skip is an error here."""

from __future__ import annotations

import io
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from trimesh.exchange.obj import load_obj
from trimesh.exchange.ply import load_ply
from trimesh.exchange.stl import load_stl
from trimesh.geometry import triangulate_quads

from inkloop.errors import GeometryError
from inkloop.geometry.body import Body

_HEADER, _TRIANGLE = 84, 50
"""Bytes of binary STL: header with the number of triangles, and each of them."""


def read_stl(path: Path) -> tuple[list[Body], None]:
    """Binary where the number of triangles agrees with the length, whatever the header says; else ASCII."""
    data = path.read_bytes()
    count = int.from_bytes(data[_HEADER - 4 : _HEADER], "little")
    if len(data) == _HEADER + count * _TRIANGLE:
        return [Body(_consecutive(load_stl(io.BytesIO(data))), path.stem)], None
    _check_ascii(path, data, count)
    count = len(re.findall(rb"\bfacet\s+normal\b", data, re.IGNORECASE))
    return [_body(path, count, load_stl, data)], None


def read_obj(path: Path) -> tuple[list[Body], None]:
    """All objects as one body; polygons become fans of triangles. Materials are not read."""
    data = path.read_bytes()
    if re.search(rb"^[ \t]*f[ \t][^\n]*-", data, re.MULTILINE):
        raise GeometryError(f"{path}: has faces with relative (negative) indices; save it with absolute ones")
    count = len(re.findall(rb"^[ \t]*f[ \t]", data, re.MULTILINE))
    try:
        return [_body(path, count, load_obj, data, skip_materials=True)], None
    except IndexError as error:
        vertices = len(re.findall(rb"^[ \t]*v[ \t]", data, re.MULTILINE))
        raise GeometryError(
            f"{path}: has faces of vertices that it does not hold ({error}); needs 1 to {vertices}: save it again"
        ) from error


def read_ply(path: Path) -> tuple[list[Body], None]:
    """ASCII or binary; polygons become fans of triangles."""
    data = path.read_bytes()
    declared = re.search(rb"^element\s+face\s+(\d+)", data, re.MULTILINE)
    return [_body(path, int(declared[1]) if declared else 0, load_ply, data, skip_materials=True)], None


def _check_ascii(path: Path, data: bytes, count: int) -> None:
    """Raises GeometryError for a file that is neither text nor binary of the right length."""
    begins_as_text = data.lstrip()[:5].lower() == b"solid"
    if begins_as_text and b"\0" not in data:
        return
    if len(data) < _HEADER:
        found = f"has {len(data)} bytes" if data else "is empty"
        raise GeometryError(
            f"{path}: {found}; expected 'solid', as ASCII STL begins, or binary STL of {_HEADER} bytes at least; "
            "save it again"
        )
    expected = _HEADER + count * _TRIANGLE
    found = "begins with 'solid' as ASCII STL does, but is binary, and" if begins_as_text else "is binary STL that"
    raise GeometryError(
        f"{path}: {found} states {count:,} triangles in its header, {expected:,} bytes; it has {len(data):,}; "
        "the file is cut off, damaged or no STL: save it again"
    )


def _body(path: Path, count: int, reader: Any, data: bytes, **options: Any) -> Body:
    """The triangles of all meshes in a file of `count` faces. Raises GeometryError if the reader skipped any."""
    with warnings.catch_warnings():  # NumPy only warns where a word is no number, or an index is none that fits
        warnings.filterwarnings("error", "string or file could not be read to its end", DeprecationWarning)
        warnings.simplefilter("error", RuntimeWarning)
        loaded: dict[str, Any] = reader(io.BytesIO(data), **options)
    meshes = loaded["geometry"].values() if "geometry" in loaded else [loaded]
    triangles = np.concatenate([np.empty((0, 3, 3)), *(_triangles(path, mesh) for mesh in meshes)])
    if len(triangles) < count:
        raise GeometryError(f"{path}: has {count:,} faces, of which {len(triangles):,} can be read; save it again")
    return Body(triangles, path.stem)


def _consecutive(loaded: dict[str, Any]) -> NDArray[np.float64]:
    """Triangles of binary STL, whose corners trimesh gives in their order."""
    return np.asarray(loaded.get("vertices", np.empty((0, 3))), dtype=np.float64).reshape(-1, 3, 3)


def _triangles(path: Path, mesh: dict[str, Any]) -> Any:
    faces = mesh.get("faces")
    if faces is None or not len(faces):
        return np.empty((0, 3, 3))
    vertices, indices = np.asarray(mesh["vertices"], dtype=np.float64), triangulate_quads(faces)
    if indices.min() < 0 or indices.max() >= len(vertices):
        raise GeometryError(
            f"{path}: has faces of vertices {indices.min()} to {indices.max()}; needs 0 to {len(vertices) - 1}"
        )
    return vertices[indices]
