"""Meshes as parts: where they land, which ink is where, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tools import parts

from inkloop.errors import ScenarioError
from inkloop.geometry import Columns
from inkloop.geometry.body import Body
from inkloop.tables import part_mesh
from inkloop.tables.part_mesh import MeshTable
from inkloop.tables.shapes import Grid
from inkloop.units import M_PER_UM, MM_PER_M
from support.parts import PITCH_UM, with_part
from support.three_mf import mesh_object, model_xml, package

MESH = 'shape = "mesh"\nfile = "part.stl"\nunit = "mm"\n'
BOX = parts.box((10.0, 10.6), (-2.0, -1.6), 5.0, 5.03)
"""6 x 4 cells, far from the origin and over the substrate."""


@pytest.mark.parametrize("away", [0.0, 100.0, 3e4, 1e6])
def test_walls_on_centres_are_seen_as_far_as_the_coordinates_resolve_them(away: float, tmp_path: Path) -> None:
    """From 0.3 mm to 0.9 mm and 0.2 mm to 0.6 mm; at 100 mm single precision resolves 0.012 um, at 30 m 4 um."""
    box = parts.box((away + 0.3, away + 0.9), (away + 0.2, away + 0.6), 0.0, 0.03)
    write(tmp_path, box)
    remarks = with_part(MESH, tmp_path, nx=15).solid.remarks
    if away > 100.0:
        resolved = {3e4: "3.58", 1e6: "119"}[away]
        assert f"the coordinates of the file resolve {resolved} µm" in remarks[0]
        return
    assert "upright walls stand on rows of cell centres" in remarks[0]
    assert with_part(MESH, tmp_path).solid.remarks == ()


def test_object_of_several_materials_in_one_ink_is_a_remark(tmp_path: Path) -> None:
    pytest.importorskip("lib3mf", reason="3MF needs lib3mf: pip install 'inkloop[3mf]'")
    painted = mesh_object(2, BOX, "box", 0).replace("<triangle ", '<triangle pid="1" p1="1" ', 1)
    model = model_xml(painted, '<item objectid="2"/>', materials="stiff soft")
    (tmp_path / "part.3mf").write_bytes(package(model))
    (remark,) = with_part('shape = "mesh"\nfile = "part.3mf"', tmp_path).solid.remarks
    assert remark.startswith("object 'box' has triangles of several materials ('stiff', 'soft')")
    assert remark.endswith("all of it is ink A")


def errors_of(part: str, folder: Path) -> tuple[str, ...]:
    with pytest.raises(ScenarioError) as caught:
        with_part(part, folder)
    return caught.value.errors


def write(folder: Path, *bodies: parts.Triangles) -> None:
    (folder / "part.stl").write_bytes(parts.stl(np.concatenate(bodies)))


def footprint(mask: np.ndarray) -> tuple[int, int, int, int]:
    i, j = np.nonzero(mask)
    assert mask.sum() == (np.ptp(i) + 1) * (np.ptp(j) + 1)
    return int(i.min()), int(i.max()), int(j.min()), int(j.max())


@pytest.mark.parametrize(
    ("keys", "expected", "height_um"),
    [
        ("", (4, 9, 4, 7), 30.0),
        ("rotate_deg = [0.0, 0.0, 90.0]", (5, 8, 3, 8), 30.0),
        ("scale = 2.0", (1, 12, 2, 9), 60.0),
        ("center_x_um = 550.0\ncenter_y_um = 450.0", (3, 8, 3, 6), 30.0),
        ("center_x_um = 550.0", (3, 8, 4, 7), 30.0),
        ("center_y_um = 450.0", (4, 9, 3, 6), 30.0),
        ('mirror = "z"', (4, 9, 4, 7), 30.0),
    ],
)
def test_mesh_stands_on_the_substrate_where_it_is_put(
    keys: str, expected: tuple[int, int, int, int], height_um: float, tmp_path: Path
) -> None:
    write(tmp_path, BOX)
    scenario = with_part(MESH + keys, tmp_path)
    job = scenario.job()
    assert footprint(job.mask) == expected
    i_min, i_max, j_min, j_max = expected
    box = [100.0 * (edge + shift) for edge, shift in ((i_min, -0.5), (i_max, 0.5), (j_min, -0.5), (j_max, 0.5))]
    assert [value / M_PER_UM for value in scenario.solid.bounds] == pytest.approx(box, rel=1e-4, abs=0.0)
    np.testing.assert_allclose(job.target_height[job.mask], height_um * M_PER_UM, rtol=1e-4)  # STL: single precision


def test_bodies_that_touch_and_overlap_are_one_part(tmp_path: Path) -> None:
    write(tmp_path, parts.bracket())
    scenario = with_part(MESH, tmp_path, nx=44, ny=34)
    shape = scenario.solid.shape
    assert isinstance(shape, Columns)
    assert set(np.unique(shape.counts)) == {0, 1}
    assert shape.volume * 1e9 == pytest.approx(0.8755, rel=0.01, abs=0.0)  # 6.32 mm2 and the rib over it
    assert scenario.solid.remarks == ()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_volume_that_two_boxes_share_counts_once(axis: int, tmp_path: Path) -> None:
    """Two boxes of 6 x 6 x 0.03 of which the second stands two cells, or 0.01, further."""
    box = parts.box((0.0, 0.6), (0.0, 0.6), 0.0, 0.03)
    shift = np.eye(3)[axis] * [0.2, 0.2, 0.01]
    write(tmp_path, box, box + shift)
    expected = {0: 0.8 * 0.6 * 0.03, 1: 0.8 * 0.6 * 0.03, 2: 0.6 * 0.6 * 0.04}[axis]
    assert with_part(MESH, tmp_path).solid.volume == pytest.approx(expected * 1e-9, rel=1e-5, abs=0.0)


def test_remark_on_several_bodies_comes_once_and_of_paint_only_without_inks(tmp_path: Path) -> None:
    bodies = [
        Body(parts.box((x, x + 0.2), (0.0, 0.2), 0.0, 0.03) * 1e-3, name, "", paint, remarks=("two faces left out",))
        for x, name, paint in ((0.05, "one", ("stiff", "soft")), (0.45, "other", ()))
    ]
    table, grid = MeshTable(shape="mesh", file="part.stl", center_x_um=530.0), Grid(nx=14, ny=12, pitch_um=100.0)
    first, second = table.solid(grid, tmp_path, bodies).remarks
    assert first == "two faces left out"
    assert second.startswith("object 'one' has triangles of several materials ('stiff', 'soft')")
    named = table.model_copy(update={"inks": {"one": "A", "other": "B"}})
    assert named.solid(grid, tmp_path, bodies).remarks == ("two faces left out",)


@pytest.mark.parametrize(
    ("part", "expected"),
    [
        (MESH.replace("part.stl", "absent.stl"), "part.file: {folder}/absent.stl: cannot be read: No such file"),
        (MESH.replace("part.stl", "part.step"), "part.file: {folder}/part.step: has suffix '.step'; expected one of"),
        (MESH.replace('unit = "mm"', ""), "part.file: {folder}/part.stl: does not state the unit of its coordinates"),
        (MESH.replace('"mm"', '"inch"'), "part.unit is 'inch'; expected 'um', 'mm', 'cm', 'm', 'in' or 'ft'"),
        (
            MESH + "scale = 4.0",
            "part reaches beyond the grid of 14 x 12 cells: it is 2400 x 1600 µm wide; with grid.nx",
        ),
        (MESH + "scale = 0.0", "part.scale is 0.0; expected greater than 0"),
        (MESH + "rotate_deg = [0.0, 90.0]", "part.rotate_deg is [0.0, 90.0]; List should have at least 3 items"),
        (MESH + 'place = "as-is"', "part.file: {folder}/part.stl: no centre of a cell lies in the part"),
        (MESH + 'place = "as-is"\ncenter_x_um = 0.0', 'part.center_x_um, center_y_um: place is "as-is"'),
        (MESH + '[part.inks]\nlogo = "A"', "part.file: {folder}/part.stl: object 'part' of material ''"),
        (MESH + "hight_um = 3.0", "part.hight_um is not a key of this table"),
    ],
)
def test_bad_mesh_table_is_refused_by_name(part: str, expected: str, tmp_path: Path) -> None:
    write(tmp_path, BOX)
    (tmp_path / "part.step").write_text("ISO-10303-21;")
    (error,) = errors_of(part, tmp_path)
    assert error.startswith(expected.format(folder=tmp_path))


def test_names_of_a_3mf_become_inks_that_share_their_walls(tmp_path: Path) -> None:
    pytest.importorskip("lib3mf", reason="3MF needs lib3mf: pip install 'inkloop[3mf]'")
    parts.write_three_mf(tmp_path / "part.3mf", parts.logo())
    part = 'shape = "mesh"\nfile = "part.3mf"\n[part.inks]\nletters = "{}"\nplate = "{}"'
    job = with_part(part.format("A", "B"), tmp_path, nx=54, ny=33).job()
    assert job.region is not None
    assert len(job.inks) == 2
    assert job.mask.sum() == 48 * 27
    x, y = np.meshgrid(*(np.arange(count) * PITCH_UM * M_PER_UM for count in (54, 33)), indexing="ij")
    in_a = job.region.contains(x, y, np.full_like(x, 60e-6))
    left, low = (x * MM_PER_M - 0.25), (y * MM_PER_M - 0.25)
    dot_of_i = (left > 0.4) & (left < 0.8) & (low > 1.9) & (low < 2.3)
    np.testing.assert_array_equal(
        in_a[(left < 1.1)], ((left > 0.4) & (left < 0.8) & (low > 0.4) & (low < 1.6) | dot_of_i)[left < 1.1]
    )
    swapped = with_part(part.format("B", "A"), tmp_path, nx=54, ny=33).job().region
    assert swapped is not None
    assert swapped.contains(x, y, np.full_like(x, 60e-6)).sum() == 48 * 27  # the plate is whole, and ink A counts first
    (error,) = errors_of(part.replace("letters", "leters").format("A", "B"), tmp_path)
    assert "no object or material is called 'leters'; did you mean letters?" in error


@pytest.mark.parametrize("mirror", ["none", "x", "y", "z"])
def test_mesh_is_mirrored_scaled_and_turned_about_x_then_y_then_z(mirror: Any) -> None:
    """Against the rotations of SciPy about axes that stay where they are."""
    grid = Grid(nx=15, ny=11, pitch_um=80.0)
    corners = np.random.default_rng(4).uniform(-3e-4, 5e-4, (7, 3, 3))
    table = MeshTable(
        shape="mesh", file="part.stl", rotate_deg=[20.0, -35.0, 110.0], scale=1.7, mirror=mirror,
        center_x_um=430.0, center_y_um=390.0,
    )  # fmt: skip
    (body,) = table.placed([Body(corners)], grid)
    flipped = 1.7 * corners * [-1.0 if axis == mirror else 1.0 for axis in "xyz"]
    expected = Rotation.from_euler("xyz", [20.0, -35.0, 110.0], degrees=True).apply(flipped.reshape(-1, 3))
    low, high = expected.min(axis=0), expected.max(axis=0)
    middle = [*(low + high)[:2] / 2, low[2]]
    np.testing.assert_allclose(
        np.sort(body.triangles.reshape(-1, 3), axis=0), np.sort(expected - middle + [430e-6, 390e-6, 0.0], axis=0),
        rtol=0.0, atol=1e-12,
    )  # fmt: skip
    centred = table.model_copy(update={"center_x_um": None, "center_y_um": None})
    (body,) = centred.placed([Body(corners)], grid)
    corner = body.triangles.reshape(-1, 3)
    found = [*(corner.min(axis=0) + corner.max(axis=0))[:2] / 2, corner[:, 2].min()]
    np.testing.assert_allclose(found, [560e-6, 400e-6, 0.0], rtol=0.0, atol=1e-12)


def test_every_body_is_looked_at_for_walls_and_for_its_resolution() -> None:
    grid = Grid(nx=15, ny=11, pitch_um=100.0)
    between = Body(parts.box((0.25, 0.65), (0.15, 0.45), 0.0, 0.03) * 1e-3)
    on_rows = Body(parts.box((0.3, 0.75), (0.15, 0.45), 0.0, 0.03) * 1e-3)
    assert list(part_mesh._remarks([between], grid)) == []
    for bodies in ([between, on_rows], [on_rows, between]):
        (remark,) = part_mesh._remarks(bodies, grid)
        assert remark.startswith("1 upright walls stand on rows of cell centres")
        assert "(at 300 µm)" in remark
    coarse = replace(between, resolution=5e-6)
    for bodies in ([between, coarse], [coarse, between]):
        (remark,) = part_mesh._remarks(bodies, grid)
        assert "resolve 5 µm" in remark


def test_mesh_as_it_is_keeps_its_coordinates_and_needs_what_holds_it(tmp_path: Path) -> None:
    write(tmp_path, parts.box((0.25, 0.65), (0.15, 0.45), 0.0, 0.02))
    assert footprint(with_part(MESH + 'place = "as-is"', tmp_path).job().mask) == (3, 6, 2, 4)
    write(tmp_path, parts.box((0.25, 0.65), (0.15, 0.45), 0.01, 0.02))
    (error,) = errors_of(MESH + 'place = "as-is"', tmp_path)
    assert error.startswith("part: 12 cells (100.0%) have nothing below them")
    (error,) = errors_of(MESH + 'place = "as-is"\n[support]\nkind = "none"', tmp_path)
    assert error.endswith("which print ink B there")


def test_part_in_ink_b_alone_has_a_region_of_ink_a_without_a_point(tmp_path: Path) -> None:
    write(tmp_path, BOX)
    for ink, count in (("B", 2), ("A", 1)):
        scenario = with_part(f'{MESH}[part.inks]\npart = "{ink}"', tmp_path)
        assert (scenario.job().mask.sum(), len(scenario.job().inks)) == (24, count)
        region = scenario.solid.region
        assert (None if region is None else int(region.mask.sum())) == (0 if ink == "B" else None)


def test_volume_of_a_mesh_with_a_hole_is_unknown(tmp_path: Path) -> None:
    """One column in a thousand is open: of 40 x 25 cells and one beside them."""
    block, single = parts.box((0.0, 4.0), (0.0, 2.5), 0.0, 0.03), parts.box((4.5, 4.6), (0.0, 0.1), 0.0, 0.03)
    for bodies, is_known in (((block, single), True), ((block, single[2:]), False)):
        write(tmp_path, *bodies)
        part = with_part(MESH + 'open_columns = "neighbours"', tmp_path, nx=52, ny=31)
        assert (part.solid.volume is not None) == is_known


def test_part_that_hangs_in_the_air_has_that_error_alone(tmp_path: Path) -> None:
    (tmp_path / "part.stl").write_bytes(parts.stl(parts.box((0.0, 0.6), (0.0, 0.4), 0.01, 0.04)))
    (error,) = errors_of(MESH + 'place = "as-is"\n', tmp_path)
    assert "have nothing below them" in error


@pytest.mark.parametrize("missing", ["none", "one triangle", "two that face each other"])
def test_mesh_whose_walls_have_holes_has_no_volume_and_is_warned_of(tmp_path: Path, missing: str) -> None:
    """No column of cells meets such a hole."""
    walls = [k for k, triangle in enumerate(BOX) if np.ptp(np.asarray(triangle)[:, 2]) > 0.0]
    left_out = {"none": [], "one triangle": walls[:1], "two that face each other": walls}[missing]
    (tmp_path / "part.stl").write_bytes(parts.stl(np.delete(np.asarray(BOX), left_out, axis=0)))
    solid = with_part(MESH, tmp_path).solid
    assert (solid.volume is not None) == (missing == "none")
    assert any("is not closed" in remark for remark in solid.remarks) == (missing != "none")


def test_open_mesh_is_refused_with_a_place_whatever_is_asked_for_single_columns(tmp_path: Path) -> None:
    (tmp_path / "part.stl").write_bytes(parts.stl(BOX[1:]))
    for keys, words in (("", "mend the mesh"), ('open_columns = "neighbours"', "of 24 columns")):
        (error,) = errors_of(MESH + keys, tmp_path)
        assert "of 24 columns" in error
        assert words in error
