"""Meshes from files: the format by the suffix, the unit by the file or by the caller, never guessed."""

from __future__ import annotations

import importlib
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from inkloop.errors import GeometryError, damaged, require
from inkloop.files import reason_of, regular
from inkloop.geometry.body import Body
from inkloop.geometry.mending import is_closed, mended, rounding
from inkloop.limits import memory_error, unpacked_error
from inkloop.units import LENGTHS

COPIES = 12
"""Times its size that reading a file takes (assumed): binary STL has 50 bytes for the 72 of a triangle."""
_FORMATS: Mapping[str, tuple[str, str, str]] = {
    ".stl": ("inkloop.geometry.triangle_file", "read_stl", ""),
    ".obj": ("inkloop.geometry.triangle_file", "read_obj", ""),
    ".ply": ("inkloop.geometry.ply_file", "read_ply", "trimesh"),
    ".3mf": ("inkloop.geometry.three_mf", "read_3mf", "lib3mf"),
}
"""Suffix -> module, function, and the library that the module imports, "" for none."""

Contents: TypeAlias = tuple[list[Body], str | None]
"""Bodies in the unit of the file, and that unit; None where the format has none."""


def read_bodies(path: Path | str, unit: str | None = None) -> tuple[Body, ...]:
    """The bodies of a mesh file in metres: STL, OBJ, PLY with `inkloop[formats]`, 3MF with `inkloop[3mf]`.

    unit: um, mm, cm, m, in or ft; may be left to 3MF, which states it. Raises GeometryError.
    """
    path = Path(path)
    bodies, declared = _contents(path)
    errors = _unit_errors(unit, declared)
    if not bodies or not all(len(body.triangles) for body in bodies):
        errors.append("holds no triangles; expected a closed surface")
    for body in bodies:
        if not np.isfinite(body.triangles).all():
            name = f" of {body.name!r}" if body.name else ""
            count = np.count_nonzero(~np.isfinite(body.triangles).all(axis=(1, 2)))
            errors.append(
                f"has corners{name} that are nan or infinite, in {count:,} of its triangles; expected numbers"
            )
    if errors:
        raise GeometryError(f"{path}: " + "; ".join(errors))
    factor = LENGTHS[declared or unit or "m"]
    return tuple(_in_metres(body, factor) for body in bodies)


def _in_metres(body: Body, factor: float) -> Body:
    """The body with the resolution of single precision: STL and 3MF have no other, texts hardly more digits."""
    triangles, cut = body.triangles * factor, body.cut * factor
    resolution = float(max(triangles.max(), -triangles.min()) * np.finfo(np.float32).eps)
    found, remarks = triangles, body.remarks
    if not is_closed(triangles):
        found, done = mended(triangles, rounding(body.triangles) * factor)
        remarks += tuple(f"{body.name}: {each}" if body.name else each for each in done)
    if not is_closed(cut):
        cut, _ = mended(cut, rounding(body.cut) * factor)
    return replace(body, triangles=found, cut=cut, remarks=remarks, resolution=resolution)


def _contents(path: Path) -> Contents:
    if path.suffix.lower() not in _FORMATS:
        raise GeometryError(f"{path}: has suffix {path.suffix!r}; expected one of {', '.join(_FORMATS)}")
    module, name, package = _FORMATS[path.suffix.lower()]
    try:
        if reason := _size_error(path):
            raise GeometryError(f"{path}: {reason}")
        if package:
            require(package, f"{path}: a mesh in this format", GeometryError)
        reader: Callable[[Path], Contents] = getattr(importlib.import_module(module), name)
        return reader(path)
    except GeometryError:
        raise
    except OSError as error:
        raise GeometryError(f"{path}: cannot be read: {reason_of(error)}") from error
    except Exception as error:  # each library fails in its own way on bytes that are cut off or altered
        raise GeometryError(damaged(path)) from error


def _size_error(path: Path) -> str | None:
    """The reason why a file is too large: its memory, or its size unpacked."""
    size = regular(path).stat().st_size
    if path.suffix.lower() == ".3mf":
        with zipfile.ZipFile(path) as archive:
            if reason := unpacked_error(archive):
                return reason
            size = sum(member.file_size for member in archive.infolist())
    return memory_error(COPIES * size)


def _unit_errors(unit: str | None, declared: str | None) -> list[str]:
    expected = ", ".join(LENGTHS)
    if unit is not None and unit not in LENGTHS:
        return [f"unit is {unit!r}; expected one of {expected}"]
    if unit is None and declared is None:
        return [f"does not state the unit of its coordinates; give unit (--unit): {expected}"]
    if unit is not None and declared is not None and unit != declared:
        return [f"states coordinates in {declared}, but unit is {unit!r}; leave unit out or correct it"]
    return []
