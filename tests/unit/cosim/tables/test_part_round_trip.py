"""A mesh that becomes slices, slices that become a part, and that part as a mesh again: the same cells all the way."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image
from tools import parts

from inkloop.geometry import Columns
from inkloop.units import MM_PER_M
from support.parts import NX, NY, PITCH_UM, with_part

LAYER_UM = 5.0
SUPPORT = '\n[support]\nkind = "below-overhangs"'


def columns(part: str, folder: Path) -> Columns:
    shape = with_part(part + SUPPORT, folder).solid.shape
    assert isinstance(shape, Columns)
    return shape


def edges(cell: int) -> tuple[float, float]:
    """Of a cell [mm]."""
    return (cell - 0.5) * PITCH_UM / 1e3, (cell + 0.5) * PITCH_UM / 1e3


def table_on_one_leg() -> parts.Triangles:
    """A leg with a hole in a sloping wall over it; its heights are no multiples of a layer."""
    slope = parts.prism([(0.0, 0.0), (0.93, 0.0), (0.93, 0.71), (0.0, 0.71)], 0.031, 0.0437)
    slope[..., 2] += np.where(slope[..., 2] > 0.04, 0.01 * slope[..., 0], 0.0)
    return np.concatenate([parts.drilled((0.33, 0.35), 0.28, 0.13, 0.0, 0.031), slope])


def test_mesh_becomes_slices_and_slices_become_a_mesh(tmp_path: Path) -> None:
    (tmp_path / "part.stl").write_bytes(parts.stl(table_on_one_leg()))
    first = columns('shape = "mesh"\nfile = "part.stl"\nunit = "mm"', tmp_path)
    assert set(np.unique(first.counts)) >= {0, 1}
    middles = (np.arange(int(np.ceil(first.height * 1e6 / LAYER_UM))) + 0.5) * LAYER_UM * 1e-6
    slices = [first.inside(np.full((NX, NY), z)) for z in middles]
    for number, inside in enumerate(slices):
        Image.fromarray(inside.T).save(tmp_path / f"s_{number}.png")
    stack = f'shape = "stack"\nfiles = "s_{{n}}.png"\nlayer_um = {LAYER_UM}\npixel_um = {PITCH_UM}'
    second = columns(stack, tmp_path)
    for inside, z in zip(slices, middles, strict=True):
        np.testing.assert_array_equal(second.inside(np.full((NX, NY), z)), inside)
    assert (np.abs(second.tops - second.bottoms) > 0.9 * LAYER_UM * 1e-6).all()
    cells = np.repeat(np.arange(NX * NY), second.counts.ravel())
    boxes = [
        parts.box(edges(i), edges(j), low, high)
        for (i, j), low, high in zip(
            (divmod(int(cell), NY) for cell in cells), second.bottoms * MM_PER_M, second.tops * MM_PER_M, strict=True
        )
    ]
    (tmp_path / "boxes.stl").write_bytes(parts.stl(np.concatenate(boxes)))
    third = columns('shape = "mesh"\nfile = "boxes.stl"\nunit = "mm"\nplace = "as-is"', tmp_path)
    np.testing.assert_array_equal(third.offsets, second.offsets)
    np.testing.assert_allclose(third.bottoms, second.bottoms, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(third.tops, second.tops, rtol=1e-6)
