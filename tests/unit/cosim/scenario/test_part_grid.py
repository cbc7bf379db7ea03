"""The grid that a part gets: its phase, its size and place, and what is refused before long work."""

from __future__ import annotations

import re
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from inkloop import limits
from inkloop.cli import main
from inkloop.errors import ScenarioError
from inkloop.scenario import part_grid
from inkloop.scenario.file import Scenario
from inkloop.scenario.new import write_for_part
from inkloop.scenario.part_file import PartFile
from inkloop.scenario.part_grid import CLOSE, FittedPart, fit
from support import meshes
from support.three_mf import mesh_object, model_xml, package

PITCH_UM = 100.0
MM = PITCH_UM * 1e-3
WEDGE = meshes.hull(np.array([(0, 0, 0), (4, 0, 0), (0, 2, 0), (4, 2, 0), (0, 0, 1), (0, 2, 1)], dtype=np.float64))
"""4 x 2 x 1 mm, highest at x = 0."""


def fitted(folder: Path, *boxes: meshes.Triangles, pitch_um: float = PITCH_UM) -> FittedPart:
    """The part of boxes in cells on its grid, as the scenario that is written for it has it."""
    path = folder / "part.stl"
    path.write_bytes(meshes.binary_stl(np.concatenate(boxes) * [MM, MM, 1.0]))
    written, part = write_for_part(folder / f"mine{len(list(folder.iterdir()))}", PartFile(path), pitch_um)
    again = Scenario.load(written).solid.columns(part.grid.nx, part.grid.ny, part.grid.pitch)
    np.testing.assert_array_equal(again.mask, cells(part), "the scenario prints what was fitted")
    return part


def cells(part: FittedPart) -> Any:
    mask = part.solid.columns(part.grid.nx, part.grid.ny, part.grid.pitch).mask
    assert mask[2:-2, 2:-2].sum() == mask.sum(), "two empty cells at every edge"
    return mask


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(
    ("wide", "deep", "pitch_um", "expected"),
    [
        (8.27, 30.0, 263.256, (8, 30)),
        (8.73, 3.0, 100.0, (9, 3)),
        (2e3 / 49.99, 1e3 / 49.99, 49.99, (40, 20)),
        (12.0, 7.0, 100.0, (12, 7)),
        (2000.0, 3.0, 100.0, (2000, 3)),
        (0.4, 5.0, 100.0, (1, 5)),
    ],
)
def test_box_gets_the_number_of_cells_next_to_its_sides(
    tmp_path: Path, wide: float, deep: float, pitch_um: float, expected: tuple[int, int], turned: bool
) -> None:
    """Single precision of the file makes 2000 cells 2000.0001."""
    turn = slice(None, None, -1 if turned else 1)
    sides = np.array([wide, deep][turn]) * pitch_um / PITCH_UM
    mask = cells(fitted(tmp_path, meshes.box((0, 0, 0), (*sides, 1)), pitch_um=pitch_um))
    assert list(mask.shape) == [count + 4 for count in expected][turn], "the first of equal phases"
    assert (mask.any(axis=1).sum(), mask.any(axis=0).sum()) == expected[turn]
    assert mask.sum() == np.prod(expected)


@pytest.mark.parametrize("seed", range(6))
def test_no_other_phase_of_the_middle_or_a_quarter_of_a_cell_is_closer_in_volume(tmp_path: Path, seed: int) -> None:
    """Boxes side by side along either axis; volumes of all phases counted one by one."""
    rng = np.random.default_rng(seed)
    low, high = rng.uniform(0.0, 5.0, (4, 2)), rng.uniform(1.5, 4.0, (4, 2))
    low[:, seed % 2] = np.arange(4) * 8.3
    high += low
    part = fitted(tmp_path, *(meshes.box((*a, 0.0), (*b, 1.0)) for a, b in zip(low, high, strict=True)))
    volume = (high - low).prod(axis=1).sum()
    assert part.solid.volume == pytest.approx(volume * MM**2 * 1e-9, rel=1e-6, abs=0.0)
    sides = high.max(axis=0) - low.min(axis=0)

    def off(phase: tuple[float, ...]) -> float:
        """Phase: of the lowest corner of the part among the centres of cells."""
        counts = [
            np.ceil(high[:, k] - low[:, k].min() + phase[k]) - np.ceil(low[:, k] - low[:, k].min() + phase[k])
            for k in (0, 1)
        ]
        return float(abs((counts[0] * counts[1]).sum() / volume - 1.0))

    phases = [
        [(count - side) / 2 + 0.5 for count in (np.floor(side), np.ceil(side))]
        + [(np.ceil(side) - side) / 2 + 0.5 + shift for shift in (0.25, -0.25)]
        for side in sides
    ]
    least = min(off(phase) for phase in product(*phases))
    found = abs(cells(part).sum() / volume - 1.0)
    assert found <= max(CLOSE, least + 1e-9)
    assert found < 0.08


def test_a_phase_without_walls_on_centres_comes_first(tmp_path: Path) -> None:
    """The gap of the two boxes begins in the middle, which is a centre where the number of cells is odd."""
    part = fitted(tmp_path, meshes.box((0, 0, 0), (4.5, 3, 1)), meshes.box((6, 0, 0), (9, 3, 1)))
    assert part.solid.remarks == ()
    assert cells(part).sum() in (21, 24)
    exact = fitted(tmp_path, meshes.box((0, 0, 0), (9, 1, 1)), meshes.box((2.5, 1, 0), (6.5, 3, 1)))
    assert exact.solid.remarks == ()
    assert cells(exact).sum() == 17
    even = fitted(tmp_path, meshes.box((0, 0, 0), (10, 1, 1)), meshes.box((2.5, 1, 0), (6.5, 3, 1)))
    assert even.solid.remarks == ()
    assert cells(even).sum() == 18


def test_of_phases_within_a_thousandth_of_the_volume_the_middle_counts(tmp_path: Path) -> None:
    """Of two walls that stand out by 1.5 cells the middle meets one cell each; a quarter of a cell away it is three."""
    walls = [meshes.box((begin, 3, 0), (begin + 1.5, 4, 1)) for begin in (2.6, 10.9)]
    part = fitted(tmp_path, meshes.box((0, 0, 0), (1000, 3, 1)), *walls)
    assert cells(part).sum() == 3002
    assert part.grid.nx == 1000 + 4
    assert "center_x_um" not in part.table.model_fields_set


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(("longer_mm", "pitch_um"), [(11.0, 263.256), (6.0, 127.0), (2.0, 42.333), (0.1, 21.167)])
def test_pitch_is_that_of_the_longer_side(tmp_path: Path, longer_mm: float, pitch_um: float, turned: bool) -> None:
    """Forty cells show it; the finest shows whatever is smaller."""
    wide, deep = (0.5 * longer_mm, longer_mm) if turned else (longer_mm, 0.5 * longer_mm)
    (tmp_path / "part.stl").write_bytes(meshes.binary_stl(meshes.box((0, 0, 0), (wide, deep, 0.1))))
    assert fit(PartFile(tmp_path / "part.stl"), None).grid.pitch_um == pitch_um


def test_text_of_a_part_offers_the_keys_that_it_leaves_out(tmp_path: Path) -> None:
    path = tmp_path / "part.stl"
    path.write_bytes(meshes.binary_stl(WEDGE))
    text = write_for_part(tmp_path / "mine", PartFile(path, unit="mm", rotate_deg=[0.0, 0.0, 90.0], scale=2.0))[0]
    head = text.read_text().partition("[part]")[2].partition("[substrate]")[0]
    assert re.findall(r"^# (\w+) =", head, re.MULTILINE) == ["place", "mirror", "open_columns", "margin_cells"]
    assert "part.inks" not in head, "one body is of one ink"
    (tmp_path / "jobs").mkdir()
    assert 'file = "../part.stl"\n' in write_for_part(tmp_path / "jobs" / "mine", PartFile(path))[0].read_text()
    assert "is assumed" not in head
    assert (
        "# the file does not state its unit, mm is assumed\n"
        in write_for_part(tmp_path / "other", PartFile(path))[0].read_text()
    )


def test_text_of_a_3mf_names_the_ink_of_each_object_and_no_unit(tmp_path: Path) -> None:
    pytest.importorskip("lib3mf", reason="3MF needs lib3mf: pip install 'inkloop[3mf]'")
    boxes = [meshes.box((x, 0, 0), (x + 4, 4, 1)) for x in (0, 4, 8)]
    objects = "".join(
        mesh_object(2 + k, box, name, k % 2)
        for k, (box, name) in enumerate(zip(boxes, ("lid", "", "lid"), strict=True))
    )
    items = "".join(f'<item objectid="{number}"/>' for number in (2, 3, 4))
    (tmp_path / "part.3mf").write_bytes(package(model_xml(objects, items, materials="stiff soft")))
    written, part = write_for_part(tmp_path / "mine", PartFile(tmp_path / "part.3mf"))
    text = written.read_text()
    assert part.names == ("lid", "soft")
    assert re.findall(r'^# "(\w+)" = "A"$', text, re.MULTILINE) == ["lid", "soft"]
    assert "is assumed" not in text
    units = [PartFile(Path(name)).mesh_unit for name in ("part.3mf", "part.3MF", "part.STL", "map.npy")]
    assert units == [None, None, "mm", None]
    assert PartFile(tmp_path / "part.3mf", unit="in").mesh_unit == "in"


@pytest.mark.parametrize(
    ("name", "shape"),
    [("A.STL", "mesh"), ("a.3mf", "mesh"), ("a.Ply", "mesh"), ("M.JSON", "layers"), ("m.npy", "height-map")],
)
def test_suffix_in_either_case_says_what_a_file_holds(name: str, shape: str) -> None:
    assert PartFile(Path(name)).shape == shape


def height_map(folder: Path, heights: Any) -> PartFile:
    np.save(folder / "map.npy", heights)
    return PartFile(folder / "map.npy", unit="um", pixel_um=PITCH_UM)


@pytest.mark.parametrize("empty", [0.0, np.nan])
@pytest.mark.parametrize("turn", range(4))
def test_map_of_which_half_is_empty_prints_in_the_middle_of_its_grid(tmp_path: Path, empty: float, turn: int) -> None:
    """Each half of either axis is empty in turn."""
    heights = np.full((6, 4), 20.0)
    heights[:, :2] = empty
    path, part = write_for_part(tmp_path / "mine", height_map(tmp_path, np.rot90(heights, turn)), PITCH_UM)
    mask = Scenario.load(path).job().mask
    filled = np.rot90(heights > 0.0, turn)
    assert mask.shape == (filled.any(axis=1).sum() + 4, filled.any(axis=0).sum() + 4)
    assert mask[2:-2, 2:-2].all()
    assert mask.sum() == filled.sum() == 12
    assert part.solid.volume == pytest.approx(12 * 20e-6 * 1e-8, rel=1e-9, abs=0.0)


@pytest.mark.parametrize(("height_um", "layers"), [(22.8, 3), (22.800001, 3), (22.8001, 4), (0.1, 1)])
def test_rounding_of_a_file_makes_no_further_layer(tmp_path: Path, height_um: float, layers: int) -> None:
    assert fit(height_map(tmp_path, np.full((6, 4), height_um)), PITCH_UM).layers == layers


def test_part_is_the_channel_that_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    np.savez("maps.npz", z_um=np.full((6, 4), 20.0), other_um=np.full((6, 4), 50.0), pixel_um=PITCH_UM)
    assert main(["new", "mine", "--part", "maps.npz", "--channel", "other_um", "--pitch-um", "100"]) == 0
    assert Scenario.load("mine.toml").solid.shape.height == pytest.approx(50e-6, rel=1e-9, abs=0.0)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["part.stl", "--pitch-um", "0.5"], "pitch_um is 0.5; expected greater than or equal to 1"),
        (["part.stl", "--pitch-um", "1e-300"], "pitch_um is 1e-300; expected greater than or equal to 1"),
        (["map.npy", "--unit", "um", "--pixel-um", "3e8"], "1.8e+09 µm wide; expected 1 µm to 1 m: give pixel_um"),
        (["map.npy", "--unit", "um", "--pixel-um", "1.5e5", "--pitch-um", "1"], "mm wide; correct --unit, --pixel-um"),
        (["zero.npy", "--unit", "um", "--pixel-um", "3"], "has nothing above 0, and so nothing to print"),
        (["map.npy", "--unit", "um", "--scale", "2", "--rotate", "x=1"], "--rotate, --scale: goes with a mesh"),
        (["part.stl", "--rotate", "z=90", "--rotate", "x=90"], "--rotate z, x: a part is turned about x, then y"),
        (["part.stl", "--rotate", "y=1", "--rotate", "y=1"], "--rotate y, y: a part is turned about x, then y"),
        (["part.stl", "--rotate", "x=nan"], "rotate_deg.[0] is nan; expected a finite number"),
        (["part.stl", "--scale", "-2"], "--scale is -2; expected a factor above 0"),
        (["part.stl", "--height-um", "inf"], "--height-um is inf; expected a length above 0"),
        (["part.stl", "--pitch-um", "nan"], "--pitch-um is nan; expected a length above 0"),
        (["part.stl", "--height-um", "0"], "--height-um is 0; expected a length above 0"),
        (["flat.stl", "--height-um", "9"], "is flat, and no scale gives it a height; turn it (--rotate)"),
    ],
)  # fmt: skip
def test_bad_sizes_are_refused_in_one_line(
    arguments: list[str], expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("part.stl").write_bytes(meshes.binary_stl(WEDGE))
    Path("flat.stl").write_bytes(meshes.binary_stl(WEDGE * [1.0, 1.0, 0.0]))
    height_map(tmp_path, np.full((6, 4), 20.0))
    np.save("zero.npy", np.zeros((6, 4)))
    for command in (["new", "mine", "--part"], ["geometry"]):
        assert main([*command, *arguments]) == 1
        assert expected in capsys.readouterr().err
    assert not Path("mine.toml").exists()


def test_pixels_far_larger_than_cells_are_refused_in_a_scenario_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, _ = write_for_part(tmp_path / "mine", height_map(tmp_path, np.full((6, 4), 20.0)), PITCH_UM)
    path.write_text(path.read_text().replace("pixel_um = 100.0", "pixel_um = 1.5e5"))
    monkeypatch.setattr(limits, "available_memory", lambda: limits.MIB)
    with pytest.raises(
        ScenarioError, match=r"a pixel is 150000 µm, a cell 100 µm: dividing it needs .* correct pixel_um"
    ):
        Scenario.load(path)


def test_long_work_is_refused_or_announced_with_its_estimate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A large grid is nobody's wish unless its pitch is."""
    path = tmp_path / "part.stl"
    path.write_bytes(meshes.binary_stl(meshes.box((0, 0, 0), (4570, 2000, 10))))
    monkeypatch.setattr("inkloop.limits.available_memory", lambda: 1 << 50)
    said: list[str] = []
    with pytest.raises(
        ScenarioError, match=r"17364 x 7601 cells of 263.256 µm takes about 2.2 min and 35 GiB of memory"
    ):
        fit(PartFile(path), None, said.append)
    monkeypatch.setattr(part_grid, "LARGE_CELLS", 1000)
    part = PartFile(path, unit="um")
    with pytest.raises(ScenarioError, match=r"the part is 4.57 x 2 mm wide; .* or give this one to go on"):
        fit(part, None, said.append)
    assert said == []
    assert fit(part, 100.0, said.append).grid.nx == 46 + 4
    assert [text.partition(" takes")[0] for text in said] == ["a grid of 50 x 24 cells of 100 µm"]
    monkeypatch.setattr(part_grid, "LARGE_CELLS", 50 * 24)
    fit(part, 100.0, said.append)
    assert len(said) == 1


def test_of_a_large_grid_only_the_middle_is_tried(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where another phase would be closer to the part."""
    boxes = meshes.box((0, 0, 0), (4.5, 3, 1)), meshes.box((6, 0, 0), (9, 3, 1))
    path = tmp_path / "part.stl"
    path.write_bytes(meshes.binary_stl(np.concatenate(boxes) * [MM, MM, 1.0]))
    assert fit(PartFile(path), PITCH_UM).solid.remarks == ()
    monkeypatch.setattr(part_grid, "LARGE_CELLS", 10)
    assert fit(PartFile(path), PITCH_UM).solid.remarks != ()
    assert main(["new", str(tmp_path / "large"), "--part", str(path), "--pitch-um", "100"]) == 0
    assert "cells of 100 µm takes about" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("turn", "highest", "size"),
    [
        (["x=90"], None, (4.0, 1.0, 2.0)),
        (["z=90"], "y first", (2.0, 4.0, 1.0)),
        (["z=-90"], "y last", (2.0, 4.0, 1.0)),
        (["y=180"], None, (4.0, 2.0, 1.0)),
        (["x=-90", "z=90"], None, (1.0, 4.0, 2.0)),
        (["x=180", "y=180"], "x last", (4.0, 2.0, 1.0)),
        ([], "x first", (4.0, 2.0, 1.0)),
    ],
)
@pytest.mark.parametrize("option", [["--scale", "0.5"], ["--height-um", "617.3"]])
def test_mesh_is_turned_then_scaled(
    turn: list[str], highest: str | None, size: tuple[float, ...], option: list[str], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capsys: Any,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    Path("part.stl").write_bytes(meshes.binary_stl(WEDGE))
    turns = [word for one in turn for word in ("--rotate", one)]
    assert main(["new", "mine", "--part", "part.stl", *turns, *option]) == 0
    scenario = Scenario.load("mine.toml")
    box, part = scenario.solid.bounds, scenario.solid.shape
    factor = 0.5e-3 if option[0] == "--scale" else 617.3e-6 / size[2]
    found = box.x_max - box.x_min, box.y_max - box.y_min
    assert found == pytest.approx([side * factor for side in size[:2]], rel=1e-6, abs=0.0)
    assert part.height == pytest.approx(size[2] * factor, rel=0.03, abs=0.0)
    if highest:
        axis, side = highest.split()
        tops = scenario.job().target_height.max(axis=1 if axis == "x" else 0)
        rows = tops[tops > 0.0]
        assert (rows[0] > 2.0 * rows[-1]) == (side == "first")
        assert (rows[-1] > 2.0 * rows[0]) == (side == "last")
    capsys.readouterr()
    assert main(["geometry", "part.stl", *turns, *option, "--no-pictures"]) == 0
    (line,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith("size"))
    assert [float(word) for word in line.split()[1:6:2]] == pytest.approx(
        [1e3 * factor * side for side in size], rel=1e-4, abs=0.0
    )


def test_part_of_many_layers_comes_with_what_to_try(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("cube.stl").write_bytes(meshes.binary_stl(meshes.box((0, 0, 0), (20, 20, 20))))
    assert main(["new", "mine", "--part", "cube.stl"]) == 0
    text = capsys.readouterr().out
    assert "about 2632 layers high; to try it: --height-um 760 makes it 100, and --set run.layers_max=20" in text
    assert main(["new", "small", "--part", "cube.stl", "--height-um", "760"]) == 0
    assert "to try" not in capsys.readouterr().out
    assert "about 100 layers" in Path("small.toml").read_text()
    assert main(["new", "most", "--part", "cube.stl", "--height-um", "3800"]) == 0
    assert "to try" not in capsys.readouterr().out
    assert "about 500 layers" in Path("most.toml").read_text()
    layers = {name: Scenario.load(f"{name}.toml").tables.run.layers_max for name in ("small", "most", "mine")}
    assert layers == {"small": 1000, "most": 1000, "mine": 2 * 2632}
    assert main(["validate", "mine.toml", "--set", "run.layers_max=20"]) == 0
    assert "about 20 layers" in capsys.readouterr().out
