"""Columns of meshes: closed at any phase of the grid, right in volume and membership, unions of bodies."""

from __future__ import annotations

import numpy as np
import pytest

from inkloop.geometry import cell_centers
from inkloop.geometry.body import Body
from inkloop.geometry.mesh_columns import Fine, MeshColumns, mesh_columns
from support import meshes
from support.meshes import Triangles

MESHES = {
    "torus": meshes.torus(60, 30, 0.35, 0.12),
    "ball": meshes.ball(40, 0.45),
    "gyroid": meshes.gyroid(24, 1.5, 0.5),
    "overlapping balls": np.concatenate([meshes.ball(30, 0.3), meshes.ball(26, 0.28) + np.array([0.2, 0.1, 0.05])]),
    "stacked boxes": np.concatenate([meshes.box((0, 0, 0), (0.6, 0.5, 0.3)), meshes.box((0, 0, 0.3), (0.6, 0.5, 0.7))]),
    "thin shell": np.concatenate([meshes.ball(40, 0.45), meshes.ball(40, 0.4499)[:, ::-1]]),
}
"""Within a cube of edge 1, in metres."""
ROOM = 1.8  # edge of a square that holds them however they are turned


def columns_of(*bodies: Triangles, cells: int = 40, pitch: float = ROOM / 40) -> MeshColumns:
    return mesh_columns([Body(triangles) for triangles in bodies], cells, cells, pitch)


def at_random_phase(triangles: Triangles, rng: np.random.Generator) -> Triangles:
    """Turned and shifted, still on the grid."""
    turned = meshes.turned(triangles - triangles.reshape(-1, 3).mean(axis=0), rng)
    return turned + rng.uniform(0.44, 0.56, 3) * ROOM


@pytest.mark.parametrize(("width", "count"), [(256.4, 256), (256.6, 257), (0.3, 1)])
def test_fine_grid_is_the_nearest_to_the_box(width: float, count: int) -> None:
    left = Fine.of([Body(meshes.box((0.0, 0.0, 0.0), (512.0, width, 1.0)))]).left
    assert (left.nx, left.ny) == (512, count)


def check_closed(count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    for triangles in MESHES.values():
        for _ in range(count):
            found = columns_of(at_random_phase(triangles, rng))
            assert found.open_cells.size == 0
            assert found.inside_out == 0
            assert found.occupied > 50


def test_closed_meshes_close_every_column_at_any_phase() -> None:
    check_closed(10, seed=1)


@pytest.mark.long
def test_closed_meshes_close_every_column_at_a_thousand_phases() -> None:
    check_closed(1000, seed=2)


def test_closed_meshes_with_corners_on_cell_centres_close_every_column() -> None:
    """Corners and edges of coarse coordinates lie exactly on rows and centres, many triangles are upright."""
    rng = np.random.default_rng(3)
    for _ in range(50):
        points = rng.integers(0, 9, (12, 3)).astype(np.float64)
        hull = meshes.hull(points)
        found = columns_of(hull, cells=10, pitch=1.0)
        assert found.open_cells.size == found.inside_out == 0
        far = columns_of(hull * 3.0, hull, cells=28, pitch=1.0)
        assert far.open_cells.size == far.inside_out == 0


def test_a_mesh_is_the_same_over_a_part_of_the_grid() -> None:
    """The whole grid is done in bands of rows, the part is one band."""
    triangles = at_random_phase(MESHES["gyroid"], np.random.default_rng(8)) / ROOM
    whole = mesh_columns([Body(triangles)], 256, 300, 1.0 / 256)
    part = mesh_columns([Body(triangles - [100 / 256, 0.0, 0.0])], 60, 300, 1.0 / 256).columns
    x, y = cell_centers(60, 300, 1.0 / 256)
    assert whole.open_cells.size == 0
    np.testing.assert_array_equal(whole.columns.counts[100:160], part.counts)
    np.testing.assert_allclose(whole.columns.top(x + 100 / 256, y), part.top(x, y), rtol=1e-6)


@pytest.mark.parametrize("name", ["torus", "ball", "gyroid"])
def test_volume_converges_to_that_of_the_divergence_theorem(name: str) -> None:
    """Order 1 at least: the error of a column is the pitch times the slope, and it averages out."""
    rng, cells = np.random.default_rng(4), np.array([20, 40, 80, 160])
    volume = meshes.volume(MESHES[name])
    errors = np.zeros((6, cells.size))
    for row in errors:
        triangles = at_random_phase(MESHES[name], rng)
        row[:] = [columns_of(triangles, cells=n, pitch=ROOM / n).columns.volume / volume - 1.0 for n in cells]
    error = np.sqrt((errors**2).mean(axis=0))
    order = -np.polyfit(np.log(cells), np.log(error), 1)[0]
    assert order >= 1.0
    assert error[-1] < 2e-3


def test_mesh_of_a_ball_contains_what_the_ball_contains() -> None:
    cells, radius, n = 61, 0.7, 40
    pitch, rng = 2.0 / cells, np.random.default_rng(6)
    middle = np.array([1.013, 0.987, 0.75])
    found = columns_of(meshes.ball(n, radius) + middle, cells=cells, pitch=pitch).columns
    x, y = cell_centers(cells, cells, pitch)
    chord_error = radius * (1.0 - np.cos(np.pi / n) ** 2)  # along the meridians and across them
    for z in rng.uniform(0.0, 1.5, (20, cells, cells)):
        depth = radius - np.sqrt((x - middle[0]) ** 2 + (y - middle[1]) ** 2 + (z - middle[2]) ** 2)
        is_far = (depth < 0.0) | (depth > chord_error)
        assert is_far.mean() > 0.9
        np.testing.assert_array_equal(found.inside(z)[is_far], (depth > 0.0)[is_far])


def test_of_two_walls_on_rows_of_centres_one_belongs_to_the_box_and_stacked_boxes_are_one_interval() -> None:
    found = columns_of(meshes.box((2.0, 3.0, 0.0), (6.0, 6.0, 1.0)), cells=10, pitch=1.0).columns
    expected = np.zeros((10, 10), dtype=np.bool_)
    expected[2:6, 3:6] = True
    np.testing.assert_array_equal(found.mask, expected)
    found = columns_of(meshes.box((1, 1, 0), (4, 4, 1)), meshes.box((1, 1, 1), (4, 4, 3)), cells=6, pitch=1.0).columns
    assert found.counts.max() == 1
    assert set(found.tops) == {3.0}


def test_overlapping_bodies_are_their_union() -> None:
    bodies = [meshes.ball(30, 0.4) + np.array(middle) for middle in ((0.7, 0.8, 0.5), (1.0, 0.9, 0.6))]
    both, one, other = (columns_of(*parts).columns for parts in (bodies, bodies[:1], bodies[1:]))
    union = one | other
    assert (one & other).volume > 0.05
    for name in ("offsets", "bottoms", "tops"):
        np.testing.assert_array_equal(getattr(both, name), getattr(union, name))


def test_cavity_is_empty() -> None:
    hollow = columns_of(meshes.box((1, 1, 0), (5, 5, 4)), meshes.box((2, 2, 1), (4, 4, 3))[:, ::-1], cells=6, pitch=1.0)
    x, y = np.full(4, 3.0), np.full(4, 3.0)
    z = np.array([0.5, 1.5, 2.5, 3.5])
    np.testing.assert_array_equal(hollow.columns.contains(x, y, z), [True, False, False, True])
    assert hollow.open_cells.size == hollow.inside_out == 0


def test_faces_turned_over_and_missing_ones_leave_no_interval_and_are_counted() -> None:
    found = columns_of(meshes.box((1, 1, 0), (5, 5, 4))[:, ::-1], cells=6, pitch=1.0)
    assert found.columns.volume == 0.0
    assert (found.inside_out, found.occupied, found.inside_out_cell) == (16, 16, 7)
    triangles = meshes.box((1, 1, 1), (5, 5, 4))
    is_top = (triangles[..., 2] == 4.0).all(axis=1)
    found = columns_of(triangles[~is_top], cells=6, pitch=1.0)
    i, j = np.divmod(found.open_cells, 6)
    assert set(zip(i.tolist(), j.tolist(), strict=True)) == {(i, j) for i in range(1, 5) for j in range(1, 5)}
    assert found.columns.tops.size == found.overlap == 0


def test_what_lies_outside_the_grid_is_cut_off() -> None:
    found = columns_of(meshes.box((-50, -50, 0), (3.5, 1.5, 1)), meshes.box((9, 9, 0), (70, 70, 1)), cells=6, pitch=1.0)
    assert found.columns.mask.sum() == 4 * 2
    assert found.open_cells.size == 0


def test_two_inks_cut_from_one_mesh_share_no_point_and_leave_none() -> None:
    """At a random height of every column, and on the cut itself."""
    rng = np.random.default_rng(7)
    cells, pitch = 40, 0.25
    inside = 0
    for _ in range(20):
        whole = meshes.hull(rng.uniform(0.5, 9.0, (12, 3)))
        normal = rng.normal(size=3)
        halves = meshes.halves(whole, normal, float(normal @ rng.uniform(3.0, 6.0, 3)))
        one, other = (columns_of(half, cells=cells, pitch=pitch) for half in halves)
        total = columns_of(whole, cells=cells, pitch=pitch).columns
        assert one.open_cells.size == other.open_cells.size == 0
        assert (one.columns & other.columns).tops.size == 0
        for z in rng.uniform(0.0, 10.0, (10, cells, cells)):
            in_one, in_other = one.columns.inside(z), other.columns.inside(z)
            assert not (in_one & in_other).any()
            np.testing.assert_array_equal(in_one | in_other, total.inside(z))
            inside += int(in_one.sum()) * int(in_other.sum() > 0)
        assert ((one.columns | other.columns).offsets == total.offsets).all()  # no gap at the cut
    assert inside > 1000
