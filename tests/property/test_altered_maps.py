"""Altered map files, the same ones every time: read as what they hold, or refused with a message, never misread.

An alteration of so many bytes may change so many heights, or all of them by one factor, where it meets a unit. More
heights, other rows or another shape are a misreading.
"""

from __future__ import annotations

import io
import random
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sdfio
import tifffile
from PIL import Image

from inkloop.errors import HeightMapError
from inkloop.metrology.height_map import HeightMap
from inkloop.metrology.map_file import read
from inkloop.metrology.map_writing import write

NX, NY, STEP = 9, 7, 5.0
Z = np.round(np.random.default_rng(8).normal(0.0, 20.0, (NX, NY)), 2)
"""(9, 7) heights [um], no two alike."""
EACH = 64


def table(separator: str, header: str = "", point: str = ".") -> bytes:
    rows = [separator.join(f"{z:.2f}".replace(".", point) for z in row) for row in Z.T]
    return (header + "\n".join(rows) + "\n").encode()


def points() -> bytes:
    listed = [f"{i * STEP} {j * STEP} {Z[i, j]:.2f}" for j in range(NY) for i in range(NX)]
    return ("nx 9\nny 7\nx [um] y [um] z [um]\n" + "\n".join(listed) + "\n").encode()


def saved(save: Callable[..., Any], *given: Any, **named: Any) -> bytes:
    file = io.BytesIO()
    save(file, *given, **named)
    return file.getvalue()


COUNTS = np.rint(Z.T - Z.min()).astype(np.uint8)
LABELLED = "dx = 5 um\ndy = 5 um\nunit = um\n"
GIVEN: dict[str, Any] = {"unit": "um", "pixel": STEP * 1e-6}
FILES: dict[str, tuple[bytes, dict[str, Any]]] = {
    "labelled.csv": (table(";", LABELLED, ","), {}),
    "spaces.txt": (table(" ", LABELLED), {}),
    "gwyddion.txt": (table("\t", "# Kanal: Z\n# Breite: 45 \u00b5m\n# H\u00f6he: 35 \u00b5m\n# Einheit: \u00b5m\n"), {}),
    "esri.asc": (table(" ", "ncols 9\nnrows 7\ncellsize 5\nNODATA_value -9999\n"), GIVEN),
    "points.txt": (points(), {}),
    "array.npy": (saved(np.save, Z), GIVEN),
    "arrays.npz": (saved(np.savez, z_um=Z, pixel_um=STEP), {}),
    "plain.tif": (saved(tifffile.imwrite, Z.T.astype(np.float32)), GIVEN),
    "packed.tif": (saved(tifffile.imwrite, Z.T.astype(np.float32), compression="zlib"), GIVEN),
    "grey.png": (saved(Image.fromarray(COUNTS).save, "PNG"), {**GIVEN, "scale": 1.0}),
    "grey.bmp": (saved(Image.fromarray(COUNTS).save, "BMP"), {**GIVEN, "scale": 1.0}),
}
WRITTEN = {"tiff": {}, "sdf": {}, "x3p": {}}
