"""Parts that are combined hold the points that each of them, asked alone, says they hold."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from inkloop.component import BoolMap
from inkloop.errors import ScenarioError
from inkloop.geometry import Cuboid, Cylinder, cell_centers
from inkloop.scenario.file import Scenario
from inkloop.tables.shapes import CylinderTable, Grid
from support.parts import NX, NY, PITCH_UM, with_part

PITCH = PITCH_UM * 1e-6
BOX = 'shape = "cuboid", size_x_um = 480.0, size_y_um = 400.0, height_um = 30.0, center_x_um = 520.0'
ROD = 'shape = "cylinder", radius_um = 230.0, height_um = 50.0, center_x_um = 810.0'
TABLES = f"parts = [{{ {BOX} }}, {{ {ROD} }}]"


def sampled() -> tuple[np.ndarray, BoolMap, BoolMap]:
    """One random height for each cell, and whether the box and the rod hold that point."""
    x, y = cell_centers(NX, NY, PITCH)
    z = np.random.default_rng(11).uniform(0.0, 60e-6, x.shape)
    middle = (NY - 1) / 2 * PITCH
    box = np.asarray(Cuboid(520e-6, middle, 480e-6, 400e-6, 30e-6).contains(x, y, z))
    rod = np.asarray(Cylinder(810e-6, middle, 230e-6, 50e-6).contains(x, y, z))
    assert (box & rod).any()
    assert (box & ~rod).any()
    assert (rod & ~box).any()
    return z, box, rod


def combined(op: str, folder: Path, keys: str = "") -> Scenario:
    return with_part(f'shape = "combine"\nop = "{op}"\n{TABLES}\n{keys}', folder)


def test_ink_of_the_top_and_of_the_bottom_goes_on_beyond_them(tmp_path: Path) -> None:
    """The middle of the last droplet lies over the target, and a scan may show the first one below the substrate."""
    x, y = cell_centers(NX, NY, PITCH)
    for inks, is_a in (('["A", "B"]', True), ('["B", "A"]', False)):
        job = combined("union", tmp_path, f"inks = {inks}").job()
        assert job.region is not None
        for cell, rod in (((3, 5), False), ((5, 5), False), ((9, 5), True)):
            expected = is_a != rod
            for z in (-3e-6, 1e-6, job.target_height[cell] - 1e-6, job.target_height[cell] + 3e-6):
                assert job.region.contains(x[cell], y[cell], np.array(z)) == expected


def test_combinations_are_parts_of_combinations(tmp_path: Path) -> None:
    _, box, rod = sampled()
    inner = f'{{ shape = "combine", op = "intersection", {TABLES} }}'
    part = f'shape = "combine"\nop = "difference"\nparts = [{{ {BOX} }}, {inner}]'
    shape = with_part(part, tmp_path).solid.shape
    x, y = cell_centers(NX, NY, PITCH)
    z = sampled()[0]
    np.testing.assert_array_equal(shape.contains(x, y, z), box & ~rod)


def test_one_ink_has_no_region_and_plain_shapes_stay_formulas(tmp_path: Path) -> None:
    assert combined("union", tmp_path).job().region is None
    plain = with_part(BOX.replace(", ", "\n"), tmp_path)
    assert isinstance(plain.solid.shape, Cuboid)


def test_errors_of_all_parts_come_at_once_with_their_place(tmp_path: Path) -> None:
    stack = '{ shape = "stack", files = "a{n}.png", layer_um = 5.0, pixel_um = 9.0 }'
    parts = f'shape = "combine"\nop = "union"\nparts = [{stack}, {{ shape = "height-map", file = "b.npy" }}]'
    with pytest.raises(ScenarioError) as caught:
        with_part(f'{parts}\ninks = ["A"]', tmp_path)
    first, second, third = caught.value.errors
    assert first == "part.inks has 1 entries for 2 parts; give one for each"
    assert second.startswith("part.parts.[0].files is 'a{n}.png': no file in ")
    assert third.startswith("part.parts.[1].file: ")


def test_wrong_keys_of_parts_are_named_where_they_stand(tmp_path: Path) -> None:
    parts = '{ shape = "cylinder", radius_um = -1.0, heigth_um = 4.0 }, { shape = "ball" }'
    with pytest.raises(ScenarioError) as caught:
        with_part(f'shape = "combine"\nop = "union"\nparts = [{parts}]', tmp_path)
    assert sorted(error.split(";")[0] for error in caught.value.errors) == [
        "part.parts.[0].height_um is missing",
        "part.parts.[0].heigth_um is not a key of this table",
        "part.parts.[0].radius_um is -1.0",
        "part.parts.[1].shape is 'ball'",
    ]


def test_two_inks_leave_no_ink_for_a_support(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError) as caught:
        combined("union", tmp_path, 'inks = ["A", "B"]\n[support]\nmargin_cells = 1')
    (error,) = caught.value.errors
    assert error.startswith("part has two inks, and support takes ink B for itself")


def test_part_beyond_the_grid_or_its_margin_is_refused_with_the_grid_that_it_needs(tmp_path: Path) -> None:
    moved = BOX.replace("520.0", "130.0").replace(", ", "\n")
    with pytest.raises(ScenarioError) as caught:
        with_part(moved, tmp_path)
    (error,) = caught.value.errors
    assert "it is 480 x 400 µm wide; with grid.nx >= 9 and grid.ny >= 8 it fits in the middle" in error
    with_part(BOX.replace("520.0", "350.0").replace(", ", "\n"), tmp_path)
    with pytest.raises(ScenarioError, match="the grid of 14 x 12 cells less its margin of 3: it is 480 x 400 µm"):
        with_part(BOX.replace("520.0", "350.0").replace(", ", "\n") + "\n[support]\nmargin_cells = 3", tmp_path)


PLATE = 'shape = "cuboid", size_x_um = 380.0, size_y_um = 980.0, height_um = 40.0, center_x_um = 640.0'


@pytest.mark.parametrize("op", ["union", "difference", "intersection"])
@pytest.mark.parametrize("inks", [None, "AAB", "ABA", "BAA", "ABB"])
def test_three_parts_are_combined_in_their_order(op: str, inks: str | None, tmp_path: Path) -> None:
    """Ink A of what is left: of a union that of the first part there, else that of the first of all parts."""
    z, box, rod = sampled()
    x, y = cell_centers(NX, NY, PITCH)
    plate = np.asarray(Cuboid(640e-6, (NY - 1) / 2 * PITCH, 380e-6, 980e-6, 40e-6).contains(x, y, z))
    bodies = [box, rod, plate]
    expected = {
        "union": box | rod | plate, "difference": box & ~rod & ~plate, "intersection": box & rod & plate
    }[op]  # fmt: skip
    key = f"inks = {list(inks)}" if inks else ""
    tables = f"parts = [{{ {BOX} }}, {{ {ROD} }}, {{ {PLATE} }}]"
    scenario = with_part(f'shape = "combine"\nop = "{op}"\n{tables}\n{key}', tmp_path)
    np.testing.assert_array_equal(scenario.solid.shape.contains(x, y, z), expected)
    assert (scenario.solid.region is None) == (inks is None)
    if inks is not None and scenario.solid.region is not None:
        first = np.select(bodies, [ink == "A" for ink in inks], default=False)
        in_a = expected & (first if op == "union" else inks[0] == "A")
        np.testing.assert_array_equal(scenario.solid.region.contains(x, y, z) & expected, in_a)


@pytest.mark.parametrize(("op", "other"), [("difference", ROD), ("intersection", BOX)])
def test_ink_of_a_part_within_a_part_ends_where_that_does(op: str, other: str, tmp_path: Path) -> None:
    """Ink B of the second part fills what the first one lacks."""
    _, box, rod = sampled()
    first = f'{{ shape = "combine", op = "{op}", inks = ["A", "B"], {TABLES} }}'
    second = f'{{ shape = "combine", op = "union", inks = ["B", "B"], parts = [{{ {other} }}, {{ {other} }}] }}'
    solid = with_part(f'shape = "combine"\nop = "union"\nparts = [{first}, {second}]', tmp_path).solid
    x, y = cell_centers(NX, NY, PITCH)
    assert solid.region is not None
    in_a = solid.region.contains(x, y, sampled()[0])
    np.testing.assert_array_equal(in_a, box & ~rod if op == "difference" else box & rod)


@pytest.mark.parametrize(
    ("op", "box_um"),
    [
        ("union", (280.0, 1040.0, 320.0, 780.0)),
        ("difference", (280.0, 760.0, 350.0, 750.0)),
        ("intersection", (580.0, 760.0, 350.0, 750.0)),
    ],
)
def test_box_of_a_combination_is_that_of_what_can_be_left(
    op: str, box_um: tuple[float, float, float, float], tmp_path: Path
) -> None:
    found = combined(op, tmp_path).solid.bounds
    assert [value * 1e6 for value in found] == pytest.approx(box_um, rel=1e-9, abs=0.0)


@pytest.mark.parametrize(
    ("center", "box"),
    [
        ({}, (150.0, 450.0, 50.0, 350.0)),
        ({"center_x_um": 0.0}, (-150.0, 150.0, 50.0, 350.0)),
        ({"center_y_um": 0.0}, (150.0, 450.0, -150.0, 150.0)),
        ({"center_x_um": 500.0, "center_y_um": 100.0}, (350.0, 650.0, -50.0, 250.0)),
    ],
)
def test_centre_is_that_of_the_grid_unless_it_is_given(center: dict[str, float], box: tuple[float, ...]) -> None:
    """Of 7 x 5 cells, also where it is 0."""
    table = CylinderTable(shape="cylinder", radius_um=150.0, height_um=9.0, **center)
    found = table.solid(Grid(nx=7, ny=5, pitch_um=100.0), Path()).bounds
    assert [value * 1e6 for value in found] == pytest.approx(box, rel=1e-9, abs=0.0)


def test_remark_on_a_part_says_which_part_it_is(tmp_path: Path) -> None:
    Image.fromarray(np.ones((4, 4), np.uint8)).save(tmp_path / "slice.png")
    stack = 'shape = "stack", files = "slice.png", layer_um = 8.0, pixel_um = 100.0, center_x_um = 700.0'
    part = f'shape = "combine"\nop = "union"\nparts = [{{ {BOX} }}, {{ {stack} }}]'
    (remark,) = with_part(part, tmp_path).solid.remarks
    assert remark.startswith("parts.[1]: along x, centres of cells lie between two pixels")
