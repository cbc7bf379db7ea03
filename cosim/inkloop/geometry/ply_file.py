"""PLY: one body, read by trimesh; faces that its reader silently skips are an error here."""

from __future__ import annotations

import io
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from trimesh.exchange.ply import load_ply
from trimesh.geometry import triangulate_quads

from inkloop.errors import GeometryError
from inkloop.geometry.body import Body


def read_ply(path: Path) -> tuple[list[Body], None]:
    """ASCII or binary; polygons become fans of triangles. Raises GeometryError, and errors of trimesh."""
    data = path.read_bytes()
    declared = re.search(rb"^element\s+face\s+(\d+)", data, re.MULTILINE)
    count = int(declared[1]) if declared else 0
    with warnings.catch_warnings():  # NumPy only warns where a word is no number, or an index is none that fits
        warnings.filterwarnings("error", "string or file could not be read to its end", DeprecationWarning)
        warnings.simplefilter("error", RuntimeWarning)
        loaded: dict[str, Any] = load_ply(io.BytesIO(data), skip_materials=True)
    faces = loaded.get("faces")
    triangles = np.empty((0, 3, 3))
    if faces is not None and len(faces):
        vertices, indices = np.asarray(loaded["vertices"], dtype=np.float64), triangulate_quads(faces)
        wrong = np.flatnonzero(((indices < 0) | (indices >= len(vertices))).any(axis=1))
        if wrong.size:
            found = ", ".join(str(index) for index in indices[wrong[0]])
            raise GeometryError(
                f"{path}: {wrong.size:,} of its triangles have vertices that it does not hold, the first number "
                f"{wrong[0] + 1}: found {found}; expected 0 to {len(vertices) - 1}: save it again"
            )
        triangles = vertices[indices]
    if len(triangles) < count:
        raise GeometryError(f"{path}: has {count:,} faces, of which {len(triangles):,} can be read; save it again")
    return [Body(triangles, path.stem)], None
