"""Columns of height intervals: membership, the half-open rule, set algebra, slices, what they refuse; their C code."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from inkloop.component import BoolMap, FloatMap, HeightIntervals
from inkloop.geometry import Columns, Cuboid, Cylinder, PipeJunction, Staircase, cell_centers, contained
from inkloop.tables.slices import columns_of_layers
from support.compiled import program
from support.places import C_SOURCES, ROOT

PITCH = 1e-4
NX, NY = 9, 7
FOLDER = ROOT / "cosim" / "columns"
SOURCES = (C_SOURCES / "column_invariants.c", *sorted(FOLDER.glob("*.c")))
FLAGS = (
    *("-std=c11", "-O1", "-g", "-ffp-contract=off", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"),
    *("-Wall", "-Wextra", "-Wconversion", "-Wpedantic", "-Werror", f"-I{FOLDER}"),
)
SHAPES = (
    Cylinder(4e-4, 3e-4, 2.5e-4, 40e-6),
    Cuboid(4e-4, 3e-4, 4e-4, 2e-4, 30e-6),
    Staircase(4e-4, 3e-4, 6e-4, 4e-4, 3, 60e-6),
    PipeJunction(4e-4, 3e-4, 3e-4, 10e-6, 2e-4, 6e-6, 20e-6),
)


@dataclass(frozen=True)
class Ball:
    """Centre and radius [m]; above the substrate or not."""

    x: float
    y: float
    z: float
    radius: float

    def contains(self, x: FloatMap, y: FloatMap, z: FloatMap) -> np.ndarray:
        return contained(self.intervals(x, y), z)

    def intervals(self, x: FloatMap, y: FloatMap) -> HeightIntervals:
        left = self.radius**2 - (x - self.x) ** 2 - (y - self.y) ** 2
        half = np.sqrt(np.maximum(left, 0.0))
        return ((np.where(left >= 0.0, self.z - half, np.inf), np.where(left >= 0.0, self.z + half, -np.inf)),)


def columns_of(offsets: list[int], bottoms: list[float], tops: list[float]) -> Columns:
    """One row of cells."""
    return Columns(1, len(offsets) - 1, PITCH, np.array(offsets), np.array(bottoms), np.array(tops))


def of(shape) -> Columns:
    return Columns.of_shape(shape, NX, NY, PITCH)


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
def test_columns_of_a_shape_contain_what_the_shape_contains(shape) -> None:
    x, y = cell_centers(NX, NY, PITCH)
    columns = of(shape)
    for bottom, top in shape.intervals(x, y):
        for ends in (bottom, top):
            for z in (np.nextafter(ends, -np.inf), ends, np.nextafter(ends, np.inf)):
                np.testing.assert_array_equal(columns.inside(z), shape.contains(x, y, z))
                np.testing.assert_array_equal(columns.contains(x, y, z), shape.contains(x, y, z))
    assert columns.height == pytest.approx(shape.height, rel=1e-6, abs=0.0)


def test_intervals_are_the_heights_that_columns_contain() -> None:
    columns = of(SHAPES[3])
    x, y = cell_centers(NX, NY, PITCH)
    for ends in (*columns.bottoms, *columns.tops):
        for height in (np.nextafter(ends, -1.0), ends, np.nextafter(ends, 1.0)):
            z = np.full(x.shape, height)
            np.testing.assert_array_equal(contained(columns.intervals(x, y), z), columns.inside(z))


def test_a_point_belongs_to_the_nearest_cell_and_an_interval_holds_its_bottom_alone() -> None:
    columns = columns_of([0, 1, 1], [1e-6], [2e-6])
    zero, nan = np.zeros(2), np.full(2, np.nan)
    np.testing.assert_array_equal(columns.contains(zero, zero, np.array([1e-6, 2e-6])), [True, False])
    for point in ((nan, zero, zero + 1e-6), (zero, nan, zero + 1e-6), (zero, zero, nan)):
        assert not columns.contains(*point).any()
    assert not columns.inside(np.full((1, 2), np.nan)).any()
    along = np.array([-0.51, -0.5, 0.0, 0.49, 0.5, 1.49, 1.5]) * PITCH
    upright = Columns(2, 1, PITCH, np.array([0, 1, 1]), np.array([1e-6]), np.array([2e-6]))
    for found, x, y in ((columns, np.zeros_like(along), along), (upright, along, np.zeros_like(along))):
        inside = found.contains(x, y, np.full_like(along, 1e-6))
        np.testing.assert_array_equal(inside, [False, True, True, True, False, False, False])
        np.testing.assert_array_equal(found.top(x, y), np.where(inside, 2e-6, 0.0))


def test_columns_of_columns_are_those_of_the_nearest_cell() -> None:
    """On cells of less than half the size, the first of two columns holds for both."""
    columns = Columns(2, 1, 1.0, np.array([0, 1, 1]), np.array([0.0]), np.array([2e-6]))
    assert Columns.of_shape(columns, 2, 1, 1.0) is columns
    assert Columns.of_shape(columns, 2, 1, 0.4).mask.tolist() == [[True], [True]]


def test_closed_interval_of_one_height_is_that_height() -> None:
    point = Ball(0.0, 0.0, 1e-6, 0.0)
    columns = Columns.of_shape(point, 1, 1, PITCH)
    heights = [np.nextafter(1e-6, 0.0), 1e-6, np.nextafter(1e-6, 1.0)]
    assert [bool(columns.inside(np.full((1, 1), z))[0, 0]) for z in heights] == [False, True, False]


def test_intervals_of_cells_that_there_are_not_are_refused() -> None:
    one = np.ones(2)
    for cells in ([0, 6], [-1, 5]):
        with pytest.raises(ValueError, match=f"cells are {cells[0]} to {cells[1]}; needs 0 to 5"):
            Columns.of_intervals(2, 3, PITCH, np.array(cells), 0.0 * one, one)
    with pytest.raises(ValueError, match="2 cells, 2 bottoms, 1 tops; needs one of each"):
        Columns.of_intervals(2, 3, PITCH, np.array([0, 1]), 0.0 * one, one[:1])


def test_union_of_many_intervals_in_any_order_is_that_of_their_points() -> None:
    """On whole numbers, so that many touch, lie in each other, are the same or empty; some cells have more than 16."""
    rng, nx, ny = np.random.default_rng(5), 3, 4
    cell = np.repeat(np.arange(nx * ny), [0, 1, 2, 3, 5, 8, 12, 20, 30, 2, 7, 40])
    rng.shuffle(cell)
    bottom = rng.integers(-20, 60, cell.size).astype(float)
    top = bottom + rng.integers(-1, 5, cell.size)
    columns = Columns.of_intervals(nx, ny, 1.0, cell, bottom, top)
    middles = np.arange(-21.0, 66.0) + 0.5
    for number in range(nx * ny):
        begin, end = columns.offsets[number : number + 2]
        found = np.stack([columns.bottoms[begin:end], columns.tops[begin:end]], axis=1)
        own = cell == number
        inside = ((bottom[own][:, None] < middles) & (middles < top[own][:, None])).any(axis=0)
        covered = ((found[:, :1] < middles) & (middles < found[:, 1:])).any(axis=0)
        np.testing.assert_array_equal(covered, inside)
        assert (np.diff(found.ravel()) > 0.0).all(), "ascending, and those that touch are one"


def test_arrays_outlive_the_columns_and_cannot_be_written() -> None:
    columns = of(SHAPES[0])
    tops, volume = columns.tops, columns.volume
    with pytest.raises(ValueError, match="read-only"):
        tops[0] = 1.0
    del columns
    bottoms = [of(shape).bottoms for shape in SHAPES for _ in range(50)]
    assert len(bottoms) == 200
    assert float(tops.sum()) * PITCH**2 == pytest.approx(volume, rel=1e-6, abs=0.0)


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"offsets": [0, 1]}, "have shapes"),
        ({"offsets": [0, 2, 1]}, "do not ascend from 0"),
        ({"bottoms": [0.0, 0.5], "tops": [0.5, 1.0]}, r"cell \(0, 1\)"),
        ({"bottoms": [0.0, 1.0], "tops": [0.5, np.nan]}, r"cell \(0, 1\)"),
        ({"bottoms": [0.0, 1.0], "tops": [0.5, 1.0]}, r"cell \(0, 1\)"),
        ({"offsets": [1, 1, 2]}, r"cell \(0, 0\): its offsets do not ascend from 0 to 2"),
        ({"offsets": [0, 0, 1]}, r"cell \(0, 1\): its offsets do not ascend from 0 to 2"),
        ({"offsets": [0, 3, 3]}, r"cell \(0, 0\): its offsets do not ascend from 0 to 2"),
        ({"bottoms": [0.0, 0.0], "tops": [0.0, 2.0]}, "needs bottom < top"),
        ({"pitch": 0.0}, "a length above 0"),
        ({"ny": 0}, "a grid of 1 x 0 cells"),
        ({"nx": 0}, "a grid of 0 x 2 cells"),
    ],
)
def test_columns_that_do_not_ascend_are_refused(changed, reason) -> None:
    good: dict[str, Any] = {"nx": 1, "ny": 2, "pitch": 1.0, "offsets": [0, 0, 2]}
    good |= {"bottoms": [0.0, 1.0], "tops": [0.5, 2.0]}
    Columns(**good)
    with pytest.raises(ValueError, match=reason):
        Columns(**good | changed)
    for other in ({"nx": 2, "ny": 1}, {"pitch": 2.0}):
        with pytest.raises(ValueError, match="needs one grid"):
            _ = Columns(**good | other) | Columns(**good)


def test_algebra_of_random_trees_of_balls_is_that_of_their_points() -> None:
    rng = np.random.default_rng(5)
    x, y = cell_centers(NX, NY, PITCH)

    def tree(depth: int) -> tuple[Columns, Callable[[FloatMap], BoolMap]]:
        if depth == 0:
            ball = Ball(*rng.uniform((0.0, 0.0, 0.0, 1e-4), (9e-4, 7e-4, 5e-4, 4e-4)).tolist())
            return of(ball), lambda z: ball.contains(x, y, z)
        (left, in_left), (right, in_right) = tree(depth - 1), tree(depth - 1)
        match rng.integers(3):
            case 0:
                return left | right, lambda z: in_left(z) | in_right(z)
            case 1:
                return left & right, lambda z: in_left(z) & in_right(z)
            case _:
                return left - right, lambda z: in_left(z) & ~in_right(z)

    marked = 0
    for depth in (1, 2, 3, 4) * 5:
        columns, is_inside = tree(depth)
        heights = rng.uniform(-2e-4, 7e-4, (8, NX, NY))
        for z in heights:
            expected = is_inside(z)
            np.testing.assert_array_equal(columns.inside(z), expected)
            marked += int(expected.sum())
    assert marked > 1000


def test_every_height_has_the_label_of_its_slice() -> None:
    layers = np.random.default_rng(3).integers(0, 3, (9, NX, NY)).astype(np.int8)
    whole, *by_label = columns_of_layers(layers, NX, NY, PITCH, 7.6e-6, labels=2)
    x, y = cell_centers(NX, NY, PITCH)
    for number, layer in enumerate(layers):
        for share in (1e-9, 0.5, 1.0 - 1e-9):
            z = np.full((NX, NY), (number + share) * 7.6e-6)
            np.testing.assert_array_equal(whole.contains(x, y, z), layer > 0)
            for label, columns in enumerate(by_label, start=1):
                np.testing.assert_array_equal(columns.contains(x, y, z), layer == label)


def test_slices_that_follow_each_other_are_one_interval_and_share_no_point_with_the_next() -> None:
    layers = np.array([[[1]], [[1]], [[2]], [[0]], [[1]]], np.int8)
    whole, first, second = columns_of_layers(layers, 1, 1, PITCH, 7.6e-6, labels=2)
    np.testing.assert_array_equal(whole.bottoms, np.array([0, 4]) * 7.6e-6)
    np.testing.assert_array_equal(whole.tops, np.array([3, 5]) * 7.6e-6)
    assert first.tops[0] == second.bottoms[0]
    (whole,) = columns_of_layers([], NX, NY, PITCH, 7.6e-6, labels=0)
    assert not whole.mask.any()


@pytest.mark.compiled
def test_random_triangles_and_intervals_keep_the_invariants_of_columns() -> None:
    """Of the C code under sanitizers: no access outside of its arrays, no leak, not even of triangles that are none."""
    checked = subprocess.run(
        [program("column_invariants", SOURCES, FLAGS)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr
