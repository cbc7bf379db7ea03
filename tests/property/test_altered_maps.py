"""Altered map files, the same ones every time: read as what they hold, or refused with a message, never misread.

An alteration of so many bytes may change so many heights, or all of them by one factor, where it meets a unit. More
heights, other rows or another shape are a misreading.
"""

from __future__ import annotations

import io
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image

from inkloop.errors import HeightMapError
from inkloop.metrology.height_map import HeightMap
from inkloop.metrology.map_file import read
from inkloop.metrology.map_writing import write

NX, NY, STEP = 9, 7, 5.0
Z = np.round(np.random.default_rng(8).normal(100.0, 20.0, (NX, NY)), 2)
"""(9, 7) heights [um], no two alike."""
MOST = 72
EACH = [pytest.param(MOST, marks=pytest.mark.long), 14]
"""Alterations of each of 14 files: about 1,000, and a sample of them."""


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


COUNTS = np.rint(Z.T).astype(np.uint8)
LABELLED = "dx = 5 um\ndy = 5 um\nunit = um\n"
GIVEN: dict[str, Any] = {"unit": "um", "pixel": STEP * 1e-6}
UNSIZED: dict[str, bytes] = {
    "labelled.csv": table(";", LABELLED, ","),
    "spaces.txt": table(" ", LABELLED),
    "gwyddion.txt": table("\t", "# Kanal: Z\n# Breite: 45 \u00b5m\n# H\u00f6he: 35 \u00b5m\n# Einheit: \u00b5m\n"),
}
"""Files that do not state the number of their rows: a lost row is not noticed, but every row is one of the map."""
SIZED: dict[str, tuple[bytes, dict[str, Any]]] = {
    "esri.asc": (table(" ", "ncols 9\nnrows 7\ncellsize 5\nNODATA_value -9999\n"), GIVEN),
    "points.txt": (points(), {}),
    "array.npy": (saved(np.save, Z), GIVEN),
    "arrays.npz": (saved(np.savez, z_um=Z, pixel_um=STEP), {}),
    "plain.tif": (saved(tifffile.imwrite, Z.T.astype(np.float32)), GIVEN),
    "packed.tif": (saved(tifffile.imwrite, Z.T.astype(np.float32), compression="zlib"), GIVEN),
    "grey.png": (saved(Image.fromarray(COUNTS).save, "PNG"), {**GIVEN, "scale": 1.0}),
    "grey.bmp": (saved(Image.fromarray(COUNTS).save, "BMP"), {**GIVEN, "scale": 1.0}),
}
WRITTEN = ("tiff", "sdf", "x3p")
TYPED = b"0123456789 ,;.-xE\n\t"


def altered(whole: bytes, draw: random.Random, is_text: bool) -> tuple[bytes, int]:
    """The bytes with one alteration, and the number of heights that it may change."""
    data, at, count = bytearray(whole), draw.randrange(len(whole)), draw.randint(1, 3)
    drawn = bytes(draw.choice(TYPED) if is_text else draw.randrange(256) for _ in range(count))
    kind = draw.choice(["bytes", "bytes", "cut", "insert", "delete", *(["line", "twice"] if is_text else [])])
    if kind == "bytes":
        for byte in drawn:
            data[draw.randrange(len(data))] = byte
    elif kind == "cut":
        del data[at:]
    elif kind == "insert":
        data[at:at] = drawn
    elif kind == "delete":
        del data[at : at + count]
    else:
        lines = whole.splitlines(keepends=True)
        k = draw.randrange(len(lines))
        lines[k : k + 1] = [] if kind == "line" else [lines[k]] * 2
        return b"".join(lines), 1
    return bytes(data), 2 * count


def changed_heights(found: HeightMap, original: HeightMap, is_sized: bool) -> int:
    """Number of heights that differ, at best, after a common factor: of a unit, or of the scale of an SDF file."""
    if (is_sized and found.shape != original.shape) or found.shape[0] != original.shape[0]:
        return original.z.size
    factors = [1.0, 1e-6, 1e-3, 1e3, 1e6]
    if is_sized:
        factors.append(float(np.nanmedian(found.z / original.z)))
    differing = [~np.isclose(found.z[:, :, None], f * original.z[:, None, :], rtol=1e-5, atol=0.0) for f in factors]
    if is_sized:
        return min(int(np.einsum("ijj->", each)) for each in differing)
    return min(int(each.sum(axis=0).min(axis=1).sum()) for each in differing)


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("count", EACH)
@pytest.mark.parametrize("name", [*UNSIZED, *SIZED, *(f"written.{form}" for form in WRITTEN)])
def test_altered_map_is_read_as_it_is_or_refused(name: str, count: int, tmp_path: Path) -> None:
    path, options = tmp_path / name, dict[str, Any]()
    if name in UNSIZED:
        whole = UNSIZED[name]
    elif name in SIZED:
        whole, options = SIZED[name]
    else:
        if name.endswith("x3p"):
            pytest.importorskip("SurfaceTopography")
        write(path, HeightMap(Z * 1e-6, STEP * 1e-6, STEP * 1e-6), path.suffix[1:])
        whole = path.read_bytes()
    path.write_bytes(whole)
    original = read(path, **options)
    assert original.shape == (NX, NY)
    refused = tried = 0
    while tried < count or (refused == tried and tried < MOST):  # until one is read
        number, tried = tried, tried + 1
        data, may_change = altered(whole, random.Random(f"{name} {number}"), path.suffix in (".csv", ".txt", ".asc"))
        path.write_bytes(data)
        try:
            found = read(path, **options)
        except HeightMapError as refusal:
            words = str(refusal)
            assert words.startswith(str(path)), words
            assert len(words.splitlines()) == 1
            assert len(words) < len(str(path)) + 500
            refused += 1
        else:
            assert changed_heights(found, original, name not in UNSIZED) <= may_change, f"{name} {number}"
    assert 0 < refused < tried
