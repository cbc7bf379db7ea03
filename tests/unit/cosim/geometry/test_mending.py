"""Surfaces that rounding, repeated facets or flat ones open are mended; holes and sound surfaces stay as they are."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from inkloop.geometry import load
from inkloop.geometry.mending import is_closed, mended
from inkloop.geometry.mesh_file import read_bodies
from inkloop.report.part_flaws import holes
from support import meshes

TORUS = meshes.torus(150, 60, 1.6, 0.6)
ROUND = 5.0 * TORUS
"""11 mm from its middle."""
RNG = np.random.default_rng(5)
FAN = (TORUS[0, 0] == TORUS).all(axis=2).any(axis=1)
"""All triangles at a corner."""
FLAT = np.stack([TORUS[0, :1], TORUS[0, 1:2], TORUS[0, :1] + 0.25 * (TORUS[0, 1:2] - TORUS[0, :1])], axis=1)


def written(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


MENDED: dict[str, tuple[meshes.Triangles, meshes.Triangles, Callable[[meshes.Triangles], bytes], str]] = {
    "noise of single precision.stl": (
        TORUS, TORUS + RNG.uniform(-1e-6, 1e-6, TORUS.shape), meshes.binary_stl, "corners joined to others within 0.00",
    ),
    "noise of sines.ply": (TORUS, TORUS + 1e-18 * RNG.integers(0, 2, TORUS.shape), meshes.ply, "corners joined"),
    "rounded up and down.obj": (
        ROUND, np.floor(1e3 * ROUND + RNG.integers(0, 2, ROUND.shape)) / 1e3, meshes.obj, "joined to others within 1 ",
    ),
    "one repeated.stl": (TORUS, np.concatenate([TORUS, TORUS[7:8]]), meshes.binary_stl, "repeated left out: 1"),
    "repeated from its next corner.stl": (
        TORUS, np.concatenate([TORUS, np.roll(TORUS[7:8], 1, axis=1)]), meshes.binary_stl, "repeated left out: 1",
    ),
    "fan repeated.stl": (TORUS, np.concatenate([TORUS, TORUS[FAN]]), meshes.ascii_stl, "repeated left out: 6"),
    "without area.ply": (TORUS, np.concatenate([TORUS, FLAT]), meshes.binary_ply, "without area left out: 1"),
}  # fmt: skip


@pytest.mark.parametrize("name", MENDED)
def test_surfaces_that_rounding_or_repetition_opens_are_mended(tmp_path: Path, name: str) -> None:
    """A hole beside them stays."""
    whole, triangles, writer, remark = MENDED[name]
    for data, count in ((triangles, 0), (np.delete(triangles, 5000, axis=0), 1)):
        (body,) = read_bodies(written(tmp_path / name, writer(data)), "mm")
        assert len(body.remarks) == 1
        assert remark in body.remarks[0]
        assert [hole.edges for hole in holes([body])] == [3] * count
        assert body.volume == pytest.approx(1e-9 * meshes.volume(whole), rel=1e-3, abs=0.0)
    written(tmp_path / name, writer(triangles))
    assert load(tmp_path / name, 300, 300, 2e-5 * np.ptp(whole) / np.ptp(TORUS), unit="mm").volume > 0.0


def test_corner_that_moves_in_half_of_its_triangles_is_one_joined_corner() -> None:
    moved = TORUS.copy()
    corner = TORUS[0, 0]
    for number in np.flatnonzero(FAN)[:3]:
        moved[number, (TORUS[number] == corner).all(axis=1), 2] += 1e-7
    found, (done,) = mended(moved, 1e-6)
    assert is_closed(found)
    assert done.endswith(": 1")


def test_flat_triangle_alone_is_not_left_out() -> None:
    found, done = mended(FLAT, 1e-9)
    assert (len(found), done) == (1, [])


def test_zero_has_no_sign() -> None:
    box = meshes.box((0, 0, 0), (2, 1, 1))
    box[::2] = np.where(box[::2] == 0.0, -0.0, box[::2])
    assert is_closed(box)


def test_sound_surfaces_and_real_holes_are_left_as_they_are(tmp_path: Path) -> None:
    """Bodies on one base, a sheet of two sides, a slit that rounding does not explain, a corner far from all others."""
    low, high = meshes.box((0, 0, 0), (2, 1, 1)), meshes.box((0, 0, 0), (2, 1, 2))
    sheet = np.concatenate([high, low[:1] + 5.0, low[:1, ::-1] + 5.0])
    slit = low.copy()
    slit[[0, 6], :, 2] -= 1e-3  # two triangles of one side
    stray = TORUS.copy()
    stray[0, 0] *= 1e6
    for triangles, count in ((stray, 1), (np.concatenate([low, high]), 0), (sheet, 0), (slit, 2)):
        (body,) = read_bodies(written(tmp_path / "a.stl", meshes.binary_stl(triangles)), "m")
        np.testing.assert_array_equal(body.triangles, triangles.astype(np.float32))
        assert (body.remarks, len(holes([body]))) == ((), count)
        assert is_closed(body.triangles) == (count == 0)
