"""`inkloop export surface`: a surface of a run as a mesh or a height map."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from inkloop.exchange.layers import MESH_FORMATS, mesh
from inkloop.metrology import map_writing
from inkloop.metrology.height_map import HeightMap
from inkloop.report.terminal import Terminal
from inkloop.results.result import Result
from inkloop.results.surface import surface
from inkloop.units import M_PER_UM, UM_PER_M

SUFFIXES: Mapping[str, str] = {"tiff": ".tif"}
"""Suffix of a format that has another one than its name."""


def export(options: argparse.Namespace, console: Terminal) -> int:
    """Write the file and describe it; returns the exit code. Raises ResultError, OSError."""
    result = Result.load(options.run)
    map_ = surface(result.dataset, str(options.run), name=options.map, layer=options.layer, part=options.part)
    if options.fill_um is not None:
        map_ = replace(map_, z=np.where(map_.valid, map_.z, options.fill_um * M_PER_UM))
    form: str = options.format
    out = options.out or Path(_name(options, result) + SUFFIXES.get(form, f".{form}"))
    out.parent.mkdir(parents=True, exist_ok=True)
    (mesh if form in MESH_FORMATS else map_writing).write(out, map_, form)
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
    floor = f"closed body over the centres of the cells, floor at z = {mesh.floor_of(map_) * UM_PER_M:g} µm"
    return {
        "stl": f"{floor}; lengths in mm, z up",
        "glb": f"{floor}; lengths in m, y up, y of the grid is -z",
        "sdf": "heights in m, rows along x, the first row is y = 0",
        "x3p": "heights in m, rows along x, the first row is y = 0",
        "tiff": "heights in µm as float32, rows along x, the first row is y = 0",
        "npy": f"heights in m, the first index is along x; unit = m and {pixel} are not in it",
    }[form]
