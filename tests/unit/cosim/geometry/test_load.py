"""Meshes from files: formats, units, placement, inks, and what is refused."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from inkloop.errors import GeometryError
from inkloop.geometry import Columns, Placement, load
from inkloop.geometry.body import Body, transformed, walls_on_centers
from inkloop.geometry.mesh import _filled_by_neighbours, bodies_by_ink, closed_columns
from inkloop.geometry.mesh_file import read_bodies
from support import meshes

WRITERS = {
    "binary.stl": meshes.binary_stl,
    "solid.stl": lambda triangles: meshes.binary_stl(triangles, b"solid of a program that writes binary"),
    "ascii.stl": meshes.ascii_stl,
    "mesh.ply": meshes.ply,
    "mesh.obj": meshes.obj,
}
WEDGE = meshes.hull(np.array([(0, 0, 0), (4, 0, 0), (0, 2, 0), (4, 2, 0), (0, 0, 1), (0, 2, 1)], dtype=np.float64))
"""4 x 2 x 1, highest at x = 0."""


def written(folder: Path, name: str, data: bytes) -> Path:
    path = folder / name
    path.write_bytes(data)
    return path


def loaded(path: Path, placement: Placement | None = None, **options) -> Columns:
    """Over 60 x 50 cells of 0.1 mm."""
    return load(path, 60, 50, 1e-4, placement=placement, **{"unit": "mm", **options})


@pytest.mark.parametrize("name", WRITERS)
def test_formats_give_the_same_columns(tmp_path: Path, name: str) -> None:
    found = loaded(written(tmp_path, name, WRITERS[name](WEDGE)))
    expected = loaded(written(tmp_path, "expected.stl", meshes.binary_stl(WEDGE)))
    np.testing.assert_array_equal(found.offsets, expected.offsets)
    np.testing.assert_array_equal(found.tops, expected.tops)
    assert found.mask.sum() == 40 * 20
    assert found.height == pytest.approx(79 / 80 * 1e-3, rel=1e-6, abs=0.0)  # half a cell from the edge
    assert found.volume == pytest.approx(4e-9, rel=0.03, abs=0.0)


def test_polygons_of_obj_and_ply_become_triangles(tmp_path: Path) -> None:
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    faces = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
    obj = [f"v {x} {y} {z}" for x, y, z in corners] + ["f " + " ".join(str(n + 1) for n in face) for face in faces]
    header = ["ply", "format ascii 1.0", "element vertex 8", *(f"property float {axis}" for axis in "xyz")]
    header += ["element face 6", "property list uchar int vertex_indices", "end_header"]
    ply = [*header, *(f"{x} {y} {z}" for x, y, z in corners), *("4 " + " ".join(map(str, face)) for face in faces)]
    for name, lines in (("box.obj", obj), ("box.ply", ply)):
        (body,) = read_bodies(written(tmp_path, name, "\n".join([*lines, ""]).encode()), "mm")
        assert body.volume == pytest.approx(1e-9, rel=1e-12, abs=0.0)


def test_units_scale_the_part_and_it_stands_on_the_middle_of_the_grid(tmp_path: Path) -> None:
    (inches,) = read_bodies(written(tmp_path, "wedge.stl", meshes.binary_stl(WEDGE)), "in")
    assert np.ptp(inches.triangles[..., 0]) == pytest.approx(4 * 0.0254, rel=1e-12, abs=0.0)
    found = loaded(written(tmp_path, "wedge.stl", meshes.binary_stl(WEDGE + np.array([70.0, -3.0, 12.0]))))
    i, j = np.nonzero(found.mask)
    assert (i.min(), i.max(), j.min(), j.max()) == (10, 49, 15, 34)
    assert set(found.bottoms) == {0.0}


@pytest.mark.parametrize(
    ("placement", "first", "size", "highest"),
    [
        (Placement("as-is"), (0, 0), (40, 20), (0, 0)),
        (Placement(rotate_deg=(0, 0, 90)), (20, 5), (20, 40), (20, 5)),
        (Placement(mirror="x"), (10, 15), (40, 20), (49, 15)),
        (Placement(mirror="x", rotate_deg=(0, 0, 90)), (20, 5), (20, 40), (20, 44)),
        (Placement(scale=0.5), (20, 20), (20, 10), (20, 20)),
        (Placement(position=(2.55e-3, 1.05e-3)), (6, 1), (40, 20), (6, 1)),
    ],
)
def test_placement_moves_turns_mirrors_and_scales(tmp_path: Path, placement, first, size, highest) -> None:
    found = loaded(written(tmp_path, "wedge.stl", meshes.binary_stl(WEDGE)), placement)
    i, j = np.nonzero(found.mask)
    assert (i.min(), j.min()) == first
    assert (np.ptp(i) + 1, np.ptp(j) + 1) == size
    top = found.top(*(np.indices((60, 50)) * 1e-4))
    assert top[highest] == top.max()
    assert found.volume > 0.0


def test_part_is_turned_about_x_then_y_then_z_and_by_right_angles_exactly() -> None:
    """The y axis: about x it becomes z, about y then x, about z then y again."""
    matrix = Placement(rotate_deg=(90.0, 90.0, 90.0)).matrix
    assert (matrix @ [0.0, 1.0, 0.0]).tolist() == [0.0, 1.0, 0.0]
    assert (matrix @ [1.0, 0.0, 0.0]).tolist() == [0.0, 0.0, -1.0]
    two = Placement(rotate_deg=(90.0, -360.0, 450.0)).matrix
    assert [(two @ axis).tolist() for axis in np.eye(3)] == [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
    odd = Placement(rotate_deg=(30.0, 20.0, 10.0)).matrix
    np.testing.assert_allclose(odd @ odd.T, np.eye(3), atol=1e-15)


def test_placement_lists_all_that_is_wrong() -> None:
    with pytest.raises(ValueError, match=r"(?s)place is.*rotate_deg.*scale.*mirror is 'w'.*position is"):
        Placement("floating", (0.0, np.nan, 0.0), 0.0, "w", (np.inf, 0.0))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="as-is, which moves nothing"):
        Placement("as-is", position=(0.0, 0.0))
    with pytest.raises(ValueError, match="mirror is 'xx'; expected some of x, y and z"):
        Placement(mirror="xx")


def test_walls_on_rows_of_centres_are_found() -> None:
    box = Body(meshes.box((1e-3, 2.5e-3, 0.0), (4e-3, 6e-3, 1e-3)))
    assert walls_on_centers([box], 1e-3) == pytest.approx((1e-3, 4e-3, 6e-3), rel=1e-12, abs=0.0)
    assert walls_on_centers([Body(box.triangles + 0.5e-3)], 1e-3) == pytest.approx((3e-3,), rel=1e-12, abs=0.0)


def test_wall_is_on_a_row_as_far_as_its_coordinates_are_resolved() -> None:
    """2 per mille of a pitch beside the row, and leaning by half of that."""
    box = meshes.box((1.002e-3, 2.5e-3, 0.0), (4.5e-3, 6.5e-3, 1e-3))
    box[box[..., 0] < 2e-3, 0] += box[box[..., 0] < 2e-3][:, 2] * 1e-3
    for resolution, expected in ((1e-6, ()), (3.1e-6, (1e-3,))):
        assert walls_on_centers([Body(box, resolution=resolution)], 1e-3) == pytest.approx(expected, rel=1e-9, abs=0.0)


def test_resolution_of_a_moved_body_is_that_of_its_coarsest_coordinate() -> None:
    """x + y, y and y of coordinates that are each off by one."""
    matrix = np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    assert transformed(Body(WEDGE, resolution=1.0), matrix, np.zeros(3)).resolution == 2.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_resolution_of_a_file_is_that_of_its_farthest_coordinate(sign: float, tmp_path: Path) -> None:
    far = WEDGE - WEDGE.reshape(-1, 3).mean(axis=0) + sign * 1000.0
    (tmp_path / "a.stl").write_bytes(meshes.binary_stl(far))
    (body,) = read_bodies(tmp_path / "a.stl", "mm")
    assert body.resolution == pytest.approx(1.0 * 2.0**-23, rel=0.01, abs=0.0)


@pytest.mark.parametrize(("axis", "name", "cells"), [(0, "x", 60), (1, "y", 50)])
def test_part_reaches_to_the_edges_of_the_outer_cells_at_most(tmp_path: Path, axis: int, name: str, cells: int) -> None:
    high = cells / 10 - 0.05
    for ends, message in (
        ((-0.049, high - 0.001), ""),
        ((-0.051, 1.0), f"reaches from {name} = -0.051 mm to 1 mm"),
        ((1.0, high + 0.001), f"reaches from {name} = 1 mm to {high + 0.001:g} mm"),
    ):
        low_corner, high_corner = np.array([1.0, 1.0, 0.0]), np.array([2.0, 2.0, 1.0])
        low_corner[axis], high_corner[axis] = ends
        path = written(tmp_path, "box.stl", meshes.binary_stl(meshes.box(tuple(low_corner), tuple(high_corner))))
        if not message:
            assert loaded(path, Placement("as-is")).mask.any(axis=1 - axis).sum() == cells
            continue
        with pytest.raises(GeometryError, match=f"{message}; the cells lie between -0.05 mm and {high:g} mm"):
            loaded(path, Placement("as-is"))


def holed(triangles: meshes.Triangles, count: int) -> bytes:
    """Without the highest triangles."""
    return meshes.binary_stl(triangles[np.argsort(triangles[..., 2].mean(axis=1))[:-count]])


def partly_turned(triangles: meshes.Triangles) -> meshes.Triangles:
    """All faces but a flat one point into the body."""
    kept = np.argmax(np.abs(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])[:, 2]))
    turned = triangles[:, ::-1].copy()
    turned[kept] = triangles[kept]
    return turned


TORUS = meshes.torus(150, 60, 1.6, 0.6)
TEXT, BINARY = meshes.ascii_stl(WEDGE), meshes.binary_stl(WEDGE)
OBJ, PLY = meshes.obj(WEDGE), meshes.ply(WEDGE)
LINE = 1 + TEXT[: TEXT.index(b"4.0")].count(b"\n")
AS_OTHERS_WRITE = {
    "mark of UTF-8.stl": b"\xef\xbb\xbf" + TEXT,
    "upper case.stl": TEXT.upper(),
    "padded with NUL.stl": TEXT + bytes(57),
    "end solid.stl": TEXT.replace(b"endsolid", b"  End solid"),
    "words in the name.stl": TEXT.replace(b"solid part", b"solid vertex 1 2 3 facet normal endsolid"),
    "several solids.stl": meshes.ascii_stl(WEDGE[:5]) + meshes.ascii_stl(WEDGE[5:]),
    "carriage returns.stl": TEXT.replace(b"\n", b"\r"),
    "normals of zero area.stl": TEXT.replace(b"normal 0 0 0", b"normal -nan(ind) nan 1e999"),
    "on one line.stl": TEXT.replace(b"\n", b" ").replace(b"part", b"part\n", 1).replace(b"end", b"\nend"),
    "one byte more.stl": BINARY + b"\7",
    "almost a triangle more.stl": BINARY + 49 * b"\7",
    "padded binary.stl": BINARY + bytes(1000),
    "relative.obj": "".join(
        "".join(f"v {x!r} {y!r} {z!r} 0.5 0.5 0.5\n" for x, y, z in corners) + "f -3 -2 -1\n"
        for corners in WEDGE.tolist()
    ).encode(),
    "textures.obj": re.sub(rb"f (\d+) (\d+)", rb"  f \1/7/8\\\n\2//-9", OBJ),
}


@pytest.mark.parametrize("name", AS_OTHERS_WRITE)
def test_variants_of_the_formats_are_read(tmp_path: Path, name: str) -> None:
    (body,) = read_bodies(written(tmp_path, name, AS_OTHERS_WRITE[name]), "m")
    np.testing.assert_array_equal(body.triangles, WEDGE)
    assert body.remarks == ()


REFUSED: dict[str, tuple[str, bytes, dict[str, Any], str]] = {
    "no unit": ("a.stl", meshes.binary_stl(WEDGE), {"unit": None}, "not state the unit.*give unit .--unit.: um, mm"),
    "other unit": ("a.stl", meshes.binary_stl(WEDGE), {"unit": "mile"}, "unit is 'mile'; expected one of um"),
    "other suffix": ("a.step", b"", {}, "has suffix '.step'; expected one of .stl, .obj, .ply, .3mf"),
    "missing bytes": ("a.stl", meshes.binary_stl(WEDGE)[:-7], {}, "is binary STL that states 8 triangles.*484 bytes"),
    "a triangle more": ("a.stl", BINARY + 50 * b"\7", {}, "is binary STL that states 8 triangles.*484 b.*has 534;"),
    "binary solid": ("a.stl", meshes.binary_stl(WEDGE, b"solid")[:-7], {}, "begins with 'solid'.*but is binary"),
    "word for number": ("a.stl", TEXT.replace(b"4.0", b"four"), {}, f"line {LINE}: found 'four', expected a number"),
    "number in code": ("a.stl", TEXT.replace(b"4.0", b"4_0"), {}, f"line {LINE}: found '4_0', expected a number"),
    "word for word": ("a.stl", TEXT.replace(b"endloop", b"end", 2), {}, "line 7: found 'end', expected 'endloop'"),
    "fourth number": ("a.stl", TEXT.replace(b"4.0", b"4.0 0", 1), {}, "line 5: found '0.0', expected 'vertex'"),
    "facet lost": ("a.stl", TEXT + b"facet normal 0 0 0", {}, "ends within facet 9"),
    "nan": ("a.stl", meshes.binary_stl(np.where(WEDGE == 4, np.nan, WEDGE)), {}, "nan or infinite, in 6 of"),
    "infinite": ("a.ply", meshes.ply(WEDGE).replace(b"4.0", b"inf"), {}, "nan or infinite, in 6 of"),
    "no faces": ("a.ply", meshes.ply(WEDGE[:0]), {}, "holds no triangles"),
    "empty": ("a.stl", b"", {}, "is empty; expected 'solid'"),
    "no mesh": ("a.stl", b"hello", {}, "has 5 bytes; expected 'solid'.*or binary STL of 84 bytes at least"),
    "vertex beyond, after a polygon": (
        "a.obj",
        OBJ.replace(b"f 1 2 3", b"f 1 2 4 3\nf 1 2 99", 1),
        {},
        "line 26: .* vertex 99, expected 1 to 24",
    ),
    "vertex beyond": ("a.obj", OBJ.replace(b"f 1 2 3", b"f 1 2 99"), {}, "line 25: .* vertex 99, expected 1 to 24"),
    "face beyond": ("a.ply", PLY.replace(b"3 0 1 2", b"3 0 1 99"), {}, "number 1: found 0, 1, 99; expected 0 to 23"),
    "face one beyond": ("a.ply", PLY.replace(b"3 0 1 2", b"3 0 1 24"), {}, "number 1: found 0, 1, 24; expected 0 to"),
    "face of two": ("a.ply", PLY.replace(b"3 0 1 2", b"2 0 1"), {}, "has 8 faces, of which 7 can be read; save it"),
    "relative beyond": ("a.obj", OBJ.replace(b"f 1 2", b"f -1 -25", 1), {}, "line 25: found 'f -1 -25 3', expected"),
    "counted from 0": (
        "a.obj", re.sub(rb"f (\d+)", lambda m: b"f %d" % (int(m[1]) - 1), OBJ), {},
        "line 25: found 'f 0 2 3', expected three vertices or more, counted from 1, or back from -1; save it again",
    ),
    "all zero": ("a.obj", re.sub(rb"f .*", b"f 0 0 0", OBJ), {}, "line 25.*line 26.*line 27: [^;]*; and 5 more; save"),
    "two corners": ("a.obj", OBJ.replace(b"f 1 2 3", b"f 1 2"), {}, "line 25: found 'f 1 2', expected three vertices"),
    "two numbers": ("a.obj", OBJ.replace(b"f 1 2 3", b"v 1 2"), {}, "line 25: found 'v 1 2', expected three numbers"),
    "free form": ("a.obj", OBJ + b"surf 0 1 0 1 1 2 3 4\n", {}, "line 33: .*free-form surfaces are not read"),
    "too wide": ("a.stl", meshes.binary_stl(2 * WEDGE), {}, r"reaches from x = -1.05 mm to 6.95 mm; the cells"),
    "between centres": ("a.stl", meshes.binary_stl(WEDGE / 100), {}, "lies in the part, which is 0.04 x .*unit"),
    "inside out": ("a.stl", meshes.binary_stl(WEDGE[:, ::-1]), {}, r"800 of 800 columns \(100%\).*flip normals"),
    "partly turned": ("a.stl", meshes.binary_stl(partly_turned(WEDGE)), {}, "are open, the.*consistent"),
    "hole": ("a.stl", holed(TORUS, 400), {}, r"columns \(7\.\d%\) are open.*first at \(.*mm, \(.*mm.*mend the mesh"),
    "not a package": ("a.3mf", b"PK\3\4 no more", {}, "is damaged.*: it cannot be read as .3mf; write it again"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_bad_files_are_refused_by_name(tmp_path: Path, case: str) -> None:
    name, data, options, message = REFUSED[case]
    with pytest.raises(GeometryError, match=f"{re.escape(name)}: (cannot be read: No such file|has suffix)"):
        loaded(tmp_path / name)
    with pytest.raises(GeometryError, match=f"(?s){re.escape(name)}.*{message}"):
        loaded(written(tmp_path, name, data), **options)


def test_neighbours_fill_a_small_hole_and_refuse_a_large_one(tmp_path: Path) -> None:
    whole = load(written(tmp_path, "a.stl", meshes.binary_stl(TORUS)), 300, 300, 2e-5, unit="mm")
    path = written(tmp_path, "b.stl", holed(TORUS, 1))
    with pytest.raises(GeometryError, match=r"up to 0\.1%"):
        load(path, 300, 300, 2e-5, unit="mm")
    mended = load(path, 300, 300, 2e-5, unit="mm", open_columns="neighbours")
    np.testing.assert_array_equal(mended.mask, whole.mask)
    assert mended.volume == pytest.approx(whole.volume, rel=1e-4, abs=0.0)
    changed = np.flatnonzero(mended.counts.ravel() != whole.counts.ravel())
    assert changed.size == 0
    with pytest.raises(GeometryError, match=r"takes at most 0\.1%"):
        load(written(tmp_path, "c.stl", holed(TORUS, 200)), 300, 300, 2e-5, unit="mm", open_columns="neighbours")


def test_one_column_in_a_thousand_may_be_open_or_inside_out() -> None:
    closed, single = meshes.box((1, 1, 0), (28, 38, 1)), meshes.box((40, 1, 0), (41, 2, 1))
    is_top = (single[..., 2] == 1.0).all(axis=1)
    for other, is_open in ((single[~is_top], True), (single[:, ::-1], False)):
        found = closed_columns("a", [Body(closed), Body(other)], 60, 50, 1.0, "neighbours")
        assert (found.occupied, found.open_cells.size, found.inside_out) == (1000, is_open, not is_open)
        assert found.columns.mask.sum() == 999
        few = Body(meshes.box((1, 1, 0), (28, 37, 1)))
        with pytest.raises(GeometryError, match=r"a: 1 of 973 columns \(0\.1%\) are (open|inside out)"):
            closed_columns("a", [few, Body(other)], 60, 50, 1.0, "neighbours")


def test_first_open_columns_are_named_by_their_places(tmp_path: Path) -> None:
    box = meshes.box((1, 2, 0), (3, 4, 1))
    path = written(tmp_path, "box.stl", meshes.binary_stl(box[~(box[..., 2] == 1.0).all(axis=1)]))
    places = re.escape("first at (1, 2) mm, (1, 2.1) mm, (1, 2.2) mm; mend")
    with pytest.raises(GeometryError, match=r"400 of 400 columns \(100%\) are open.*" + places):
        loaded(path, Placement("as-is"))


def test_ink_of_a_body_is_that_of_its_object_before_that_of_its_material() -> None:
    both, plain = Body(WEDGE, "lid", "red"), Body(WEDGE, "", "red")
    found = bodies_by_ink("a", [both, plain], {"red": "A", "lid": "B"})
    assert found == {"A": [plain], "B": [both]}
    painted = Body(WEDGE, "lid", paint=("red", "blue"))
    with pytest.raises(GeometryError, match=r"^a: object 'lid' has triangles of several materials [^;]*$"):
        bodies_by_ink("a", [painted], {"red": "A", "blue": "B"})
    with pytest.raises(GeometryError, match=r"no object or material is called 'rod'; did you mean red"):
        bodies_by_ink("a", [both], {"red": "A", "lid": "B", "rod": "B"})


def test_wide_hole_is_filled_from_its_rim_inwards() -> None:
    columns = Columns.of_intervals(5, 6, 1.0, np.arange(30), np.zeros(30), np.full(30, 7.0))
    hole = np.array([i * 6 + j for i in (1, 2, 3) for j in (1, 2, 3, 4)])
    emptied = columns - Columns.of_intervals(5, 6, 1.0, hole, np.zeros(12), np.full(12, 7.0))
    assert _filled_by_neighbours(emptied, hole).tops.tolist() == [7.0] * 30


def test_open_column_at_the_edge_has_the_neighbours_on_the_grid_alone() -> None:
    """Beyond the last column along y the next row begins."""
    heights = np.full((5, 2), 9.0)
    heights[1, 1], heights[3, 1], heights[2, 0], heights[3, 0] = 1.0, 4.0, 5.0, 1.0
    columns = Columns.of_intervals(5, 2, 1.0, np.arange(10), np.zeros(10), heights.ravel())
    assert _filled_by_neighbours(columns, np.array([5])).tops[5] == 4.0


def test_open_column_is_that_of_the_median_neighbour() -> None:
    heights = np.array([9.0, 1.0, 9.0, 2.0, 0.0, 3.0, 9.0, 4.0, 9.0])
    columns = Columns.of_intervals(3, 3, 1.0, np.arange(9), np.zeros(9), heights)
    assert _filled_by_neighbours(columns, np.array([4])).tops[4] == 2.0
