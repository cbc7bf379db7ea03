"""Volumes of meshes against trimesh and lib3mf: of files that are written here, and of a thousand altered ones."""

from __future__ import annotations

import locale
import warnings
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
import pytest
from tools import parts

from inkloop.errors import GeometryError
from inkloop.exchange.layers import surface
from inkloop.geometry.mesh_file import read_bodies
from inkloop.metrology.height_map import HeightMap
from support import meshes
from support.three_mf import mesh_object, model_xml, package

trimesh = pytest.importorskip("trimesh", reason="volumes are compared with trimesh, which is not installed")
lib3mf = pytest.importorskip("lib3mf", reason="volumes are compared with lib3mf, which is not installed")

TORUS = meshes.torus(12, 8, 1.6, 0.6)
MODEL = model_xml(mesh_object(2, TORUS), '<item objectid="2" printable="1"/>').encode()
FILES = {
    "binary.stl": meshes.binary_stl(TORUS),
    "text.stl": meshes.ascii_stl(TORUS),
    "text.ply": meshes.ply(TORUS),
    "binary.ply": meshes.binary_ply(TORUS),
    "text.obj": meshes.obj(TORUS),
    "model.3mf": MODEL,
}
EACH = [pytest.param(167, marks=pytest.mark.long), 33]
"""Alterations of each of 6 files: about 1,000, and a sample of them."""
MENDED = 0.02
"""Share of its cube by which a mended mesh may differ: peers count a repeated triangle twice."""
WORDS = (
    b"",
    b"0",
    b"-1",
    b"1",
    b"9",
    b".",
    b" ",
    b"\n",
    b"-",
    b"e",
    b"/",
    b"\0",
    b"nan",
    b"f 1 2 3\n",
    b"v 1 2 3\n",
    b"_",
)


def peer_triangles(path: Path) -> meshes.Triangles:
    """By lib3mf for 3MF, which writes the build as STL; by trimesh for all others. Raises whatever they raise."""
    copy = path
    if path.suffix == ".3mf":
        model, copy = lib3mf.get_wrapper().CreateModel(), path.with_suffix(".3mf.stl")
        model.QueryReader("3mf").ReadFromFile(str(path))
        own = locale.setlocale(locale.LC_ALL)
        try:
            model.QueryWriter("stl").WriteToFile(str(copy))
        finally:
            locale.setlocale(locale.LC_ALL, own)  # its writer, which inkloop does not use, leaves the locale C
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return np.asarray(trimesh.load_mesh(copy, process=False).triangles, dtype=np.float64)


def own_triangles(path: Path) -> tuple[meshes.Triangles, bool]:
    """In metres, or in the unit of the file without one, and whether they are mended, which is told."""
    bodies = read_bodies(path, None if path.suffix == ".3mf" else "m")
    return np.concatenate([body.triangles for body in bodies]), any(body.remarks for body in bodies)


def test_files_that_are_written_here_are_read_as_peers_do(tmp_path: Path) -> None:
    for name, write in parts.FILES.items():
        if not name.endswith(".png"):
            write(tmp_path / name)
    z = np.random.default_rng(2).uniform(1e-5, 5e-5, (7, 4))
    surface.write_body(tmp_path / "surface.stl", HeightMap(z, 1e-4, 2e-4), "stl")
    for name, data in FILES.items():
        (tmp_path / name).write_bytes(package(data) if name.endswith(".3mf") else data)
    for path in sorted(tmp_path.iterdir()):
        unit = 1e9 if path.suffix == ".3mf" else 1.0
        (found, is_mended), expected = own_triangles(path), meshes.volume(peer_triangles(path))
        assert not is_mended, path
        assert meshes.volume(found) * unit == pytest.approx(expected, rel=1e-5, abs=0.0), path
        if path.stem in ("text", "binary", "model"):
            assert expected == pytest.approx(meshes.volume(TORUS), rel=1e-5, abs=0.0)


def altered(data: bytes, rng: np.random.Generator) -> bytes:
    """One or two places with bytes cut out and a word put in, or one bit turned."""
    for _ in range(rng.integers(1, 3)):
        at = int(rng.integers(len(data)))
        if rng.random() < 0.5:
            data = data[:at] + bytes([data[at] ^ 1 << rng.integers(8)]) + data[at + 1 :]
        else:
            data = data[:at] + WORDS[rng.integers(len(WORDS))] + data[at + rng.integers(4) :]
    return data


@pytest.mark.parametrize("count", EACH)
@pytest.mark.parametrize("name", FILES)
def test_altered_files_are_refused_by_name_or_mean_what_peers_read(name: str, count: int, tmp_path: Path) -> None:
    rng, path = np.random.default_rng(crc32(name.encode())), tmp_path / name
    compared, refusals = 0, list[str]()
    for _ in range(count):
        data = altered(FILES[name], rng)
        path.write_bytes(package(data) if name.endswith(".3mf") else data)
        try:
            found, is_mended = own_triangles(path)
        except GeometryError as error:
            refusals.append(str(error))
            continue
        try:
            expected: Any = peer_triangles(path)
        except Exception:  # each library fails in its own way
            continue
        if not len(expected) or not np.isfinite(expected).all():
            continue
        unit = 1e3 if name.endswith(".3mf") else 1.0
        near = np.abs(expected).max() ** 3 * (MENDED if is_mended else 1e-9 * len(expected))
        assert meshes.volume(found * unit) == pytest.approx(meshes.volume(expected), rel=1e-5, abs=near), data
        compared += not is_mended
    assert not [refusal for refusal in refusals if not refusal.startswith(str(path))]
    assert min(compared, len(refusals)) >= count // 33, (compared, len(refusals))
