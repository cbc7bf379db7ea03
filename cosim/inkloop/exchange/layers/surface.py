"""`inkloop export surface`: a surface of a run as a height map, or as a closed body.

A body is its surface, a skirt around it, and a flat floor below.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap
from inkloop.errors import ResultError, require
from inkloop.exchange.layers import MESH_FORMATS
from inkloop.files import replaced
from inkloop.metrology import map_writing
from inkloop.metrology.height_map import HeightMap
from inkloop.report.terminal import Terminal
from inkloop.results.result import Result
from inkloop.results.surface import surface
from inkloop.units import M_PER_UM, MM_PER_M, UM_PER_M

SUFFIXES: Mapping[str, str] = {"tiff": ".tif"}
"""Suffix of a format that has another one than its name."""
_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # x, y, z become x, z, -y (glTF 2.0, 3.4)


def export(options: argparse.Namespace, console: Terminal) -> int:
    """Write the file and describe it; returns the exit code. Raises ResultError, OSError."""
    result = Result.load(options.run)
    map_ = surface(result.dataset, str(options.run), name=options.map, layer=options.layer, part=options.part)
    if options.fill_um is not None:
        map_ = replace(map_, z=np.where(map_.valid, map_.z, options.fill_um * M_PER_UM))
    form: str = options.format
    out = options.out or Path(_name(options, result) + SUFFIXES.get(form, f".{form}"))
    out.parent.mkdir(parents=True, exist_ok=True)
    (write_body if form in MESH_FORMATS else map_writing.write)(out, map_, form)
    console.sentence(f"wrote {out}: {map_.source}, {_size(map_)}")
    console.sentence(f"  {_reading(map_, form)}")
    console.result(file=out, cells=map_.shape, pitch_um=map_.dx * UM_PER_M, without_height=int((~map_.valid).sum()))
    return 0


def _name(options: argparse.Namespace, result: Result) -> str:
    layer = result.dataset.sizes["layer"] - 1 if options.layer is None else options.layer
    return f"{options.run.resolve().name}-{options.map}-L{layer:04d}"


def _size(map_: HeightMap) -> str:
    missing = int((~map_.valid).sum())
    lacking = f", {missing} of them without a height" if missing else ""
    return f"{map_.shape[0]} x {map_.shape[1]} cells of {map_.dx * UM_PER_M:.12g} µm{lacking}"


def _reading(map_: HeightMap, form: str) -> str:
    """Conventions of the file for its reader."""
    pixel = f"pixel_um = {map_.dx * UM_PER_M:.12g}"
    floor = f"closed body over the centres of the cells, floor at z = {floor_of(map_) * UM_PER_M:g} µm"
    return {
        "stl": f"{floor}; lengths in mm, z up",
        "glb": f"{floor}; lengths in m, y up, y of the grid is -z",
        "sdf": "heights in m, rows along x, the first row is y = 0",
        "x3p": "heights in m, rows along x, the first row is y = 0",
        "tiff": "heights in µm as float32, rows along x, the first row is y = 0",
        "npy": f"heights in m, the first index is along x; unit = m and {pixel} are not in it",
    }[form]


def floor_of(map_: HeightMap) -> float:
    """Height of the floor [m]: a pixel below the substrate, or below the lowest point where that is deeper."""
    return min(0.0, float(map_.z.min())) - min(map_.dx, map_.dy)


def write_body(path: Path, map_: HeightMap, form: str) -> None:
    """Write the body whole or not at all: "stl" binary in mm, z up; "glb" in m, y up as glTF has it.

    Raises ResultError where a pixel has no height, for a body has a surface everywhere; InkloopError without trimesh;
    OSError.
    """
    trimesh = require("trimesh", "an STL or GLB file")
    missing = int((~map_.valid).sum())
    if missing:
        raise ResultError(
            f"{map_.source}: {missing} of {map_.z.size} cells have no height, and a body needs one everywhere; "
            "fill them with --fill-um H, or write sdf, x3p, tiff or npy"
        )
    if min(map_.shape) < 2:
        raise ResultError(f"{map_.source}: has {map_.shape[0]} x {map_.shape[1]} cells; a body needs 2 x 2")
    vertices, faces = closed_body(map_, floor_of(map_))
    vertices = vertices * MM_PER_M if form == "stl" else vertices @ _Y_UP.T
    body = trimesh.Trimesh(vertices, faces, process=False)
    with replaced(path) as partial, partial.open("wb") as file:
        body.export(file, file_type=form)


def closed_body(map_: HeightMap, floor: float) -> tuple[FloatMap, NDArray[np.int64]]:
    """Vertices (n, 3) [m] and triangles (k, 3) that run counterclockwise seen from outside.

    The surface has a vertex in the centre of each pixel, and each square between four of them has its diagonal from
    (i, j) to (i + 1, j + 1). floor: height of the floor [m], below the surface.
    """
    m, n = map_.shape
    top = np.arange(m * n).reshape(m, n)
    x, y = np.meshgrid(map_.x0 + np.arange(m) * map_.dx, map_.y0 + np.arange(n) * map_.dy, indexing="ij")
    rim = np.concatenate([top[:-1, 0], top[-1, :-1], top[:0:-1, -1], top[0, :0:-1]])  # counterclockwise from above
    foot = m * n + np.arange(rim.size)
    surface = np.column_stack([x.ravel(), y.ravel(), map_.z.ravel()])
    below = np.column_stack([surface[rim, :2], np.full(rim.size, floor)])
    middle = [[x.mean(), y.mean(), floor]]

    a, b, c, d = (one.ravel() for one in (top[:-1, :-1], top[1:, :-1], top[1:, 1:], top[:-1, 1:]))
    next_rim, next_foot = np.roll(rim, -1), np.roll(foot, -1)
    centre = np.full(rim.size, m * n + rim.size)
    triangles = [
        *((a, b, c), (a, c, d)),
        *((next_rim, rim, foot), (next_rim, foot, next_foot)),
        (centre, next_foot, foot),
    ]
    faces = np.concatenate([np.column_stack(corners) for corners in triangles])
    return np.concatenate([surface, below, middle]), faces
