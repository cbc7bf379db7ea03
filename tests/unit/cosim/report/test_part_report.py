"""Report and picture of a part before its print: what another computation finds, and what was worked out by hand."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import same_color
from matplotlib.figure import Figure
from PIL import Image
from tools import parts

from inkloop.cli import main
from inkloop.geometry import Columns
from inkloop.geometry.body import Body
from inkloop.report import part_picture, plot
from inkloop.report.part_flaws import Hole, Narrow, _pieces, holes, narrow_across, narrow_upright
from inkloop.report.part_report import MeshReport, PartReport
from inkloop.report.solid_picture import SOLID_UPRIGHT, view
from inkloop.scenario.file import Scenario
from inkloop.scenario.part_file import PartFile
from inkloop.scenario.part_grid import fit
from support.parts import TWO_INKS, with_part
from support.places import SCENARIOS

BRACKET = SCENARIOS / "parts" / "bracket.stl"


@pytest.fixture
def coarse_view(monkeypatch: pytest.MonkeyPatch) -> None:
    """Solids are seen in fewer pixels than in print."""
    for name in ("PIXELS", "STEPS"):
        monkeypatch.setattr(f"inkloop.report.solid_picture.{name}", 40)


def test_missing_faces_are_holes_and_faces_turned_over_are_seams() -> None:
    bracket, box = parts.bracket(), parts.box((0.0, 3.0), (0.0, 4.0), 0.0, 1.0)
    assert holes([Body(bracket)]) == []
    without_top = box[2:]  # the first two triangles are the upper face
    (hole,) = holes([Body(bracket + 100.0), Body(without_top)])
    assert (hole.edges, hole.center, hole.size) == (4, (1.5, 2.0, 1.0), pytest.approx(5.0, rel=1e-12, abs=0.0))
    turned = np.concatenate([box[:2, ::-1], without_top])  # the upper face points down
    (seam,) = holes([Body(turned)])
    assert (seam.edges, seam.is_seam) == (4, True)
    both = MeshReport.of([Body(turned), Body(without_top + 100.0)])
    assert sorted(hole.is_seam for hole in both.holes) == [False, True]
    sizes = [hole.size for hole in holes([Body(box[1:]), Body(box[1:] * 3.0 + 50.0), Body(box[1:] * 2.0 - 50.0)])]
    assert len(sizes) == 3
    assert sizes == sorted(sizes, reverse=True)
    other = next(k for k in range(12) if len({*map(tuple, box[0])} & {*map(tuple, box[k])}) == 1)
    (two_at_a_corner,) = holes([Body(np.delete(box, [0, other], axis=0))])
    assert two_at_a_corner.edges == 6


CUBE = parts.box((0.0, 4.0), (0.0, 4.0), 0.0, 4.0)
INNER, CROSSING = parts.box((1.0, 3.0), (1.0, 3.0), 1.0, 3.0), parts.box((1.0, 5.0), (1.0, 5.0), 1.0, 3.0)


@pytest.mark.parametrize(
    ("triangles", "bodies", "volume"),
    [
        ([CUBE], 1, 64.0),
        ([CUBE, np.add(CUBE, [5.0, 0.0, 0.0])], 2, 128.0),
        ([CUBE, INNER[:, ::-1]], 1, 56.0),
        ([CUBE, CROSSING], 2, 78.0),
        ([CUBE, np.add(CUBE, [0.0, 4.0, 0.0])], 1, 128.0),
    ],
)
@pytest.mark.parametrize("axes", [[0, 1, 2], [1, 0, 2]])
def test_separate_solids_and_the_volume_that_they_fill_are_those_of_the_file(
    triangles: list[Any], bodies: int, volume: float, axes: list[int], tmp_path: Path, monkeypatch: Any, capsys: Any
) -> None:
    """A cavity is no solid; what two solids share counts once; two that share corners are one."""
    mesh = np.concatenate(triangles)[..., axes]
    mesh = mesh if axes[0] == 0 else mesh[:, ::-1]  # exchanged axes mirror
    monkeypatch.chdir(tmp_path)
    Path("part.stl").write_bytes(parts.stl(mesh))
    arguments = ["geometry", "part.stl", "--pitch-um", "270", "--no-pictures", "--json"]
    assert main(arguments) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["bodies"] == bodies
    assert found["file_volume_mm3"] == pytest.approx(volume, rel=1e-3 if volume == 78.0 else 1e-6, abs=0.0)
    assert found["volume_mm3"] == pytest.approx(volume, rel=0.05, abs=0.0)
    share = found["volume_mm3"] / found["file_volume_mm3"] - 1.0
    assert main(arguments[:-1]) == 0
    words = f"{abs(share):.1%} {'more' if share > 0 else 'less'}" if abs(share) > 5e-4 else "the same"
    text, in_file = capsys.readouterr().out, f"{volume:g} mm3 in the file, the cells hold {words}\n"
    if volume == 78.0:  # of columns
        in_file = f"about {found['file_volume_mm3']:.3g} mm3 in the file, the cells hold about {abs(share):.0%} less\n"
        assert share < -5e-3
    assert f"               {in_file}" in text
    assert max(map(len, text.splitlines())) <= 80


def test_size_that_a_cut_changes_has_the_digits_of_columns(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    cut = parts.box((3.0, 9.0), (-1.0, 9.0), -1.0, 9.0)
    low_cut = parts.box((1.0, 2.0), (1.0, 2.0), -1.0, 2.0)
    sizes = {"": "4.0001 x 4 x 4", "low": "4.0001 x 4 x 4", "side": "3 x 4 x 4"}
    block = parts.box((0.0, 4.0001), (0.0, 4.0), 0.0, 4.0)
    for body, (name, size) in zip(
        (Body(block), Body(block, cut=low_cut), Body(block, cut=cut)), sizes.items(), strict=True
    ):
        body = replace(body, triangles=body.triangles * 1e-3, cut=body.cut * 1e-3)
        assert f"size           {size} mm" in MeshReport.of([body]).lines(), name
    monkeypatch.setattr("inkloop.tables.part_mesh.read_bodies", lambda *_: (body,))
    fitted = fit(PartFile(tmp_path / "part.stl"), 100.0)
    assert fitted.size == "3,000 x 4,000 x 4,000 µm"


@pytest.mark.system
def test_figures_of_a_file_agree_with_the_part(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["geometry", str(BRACKET), "--pitch-um", "100", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["size_mm"] == pytest.approx([4.0, 3.0, 0.228], rel=1e-6, abs=0.0)
    assert found["watertight"] is True
    assert found["grid"] == {"nx": 44, "ny": 34, "pitch_um": 100.0}
    area = 4.0 * 1.2 + 1.2 * 1.8 - 2 * np.pi * 0.32**2
    rib = 4.0 * 0.2 + 2.8 * 0.2
    assert found["volume_mm3"] == pytest.approx(area * 0.114 + rib * 0.114, rel=0.01, abs=0.0)
    assert found["layers"] == int(np.ceil(228 / (0.9 * 6.6))) + 5
    assert found["droplets"]["A"] == pytest.approx(found["volume_mm3"] * 1e9 / (100.0**2 * 7.6), abs=1.0)
    assert found["narrow"] == {}
    assert (found["memory_bytes"], found["disk_bytes"] > 5e6) == (44 * 34 * 457, True)
    with Image.open(tmp_path / "bracket-geometry.png") as picture:
        assert picture.width > 1000


def test_text_fits_into_eighty_columns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fin.stl").write_bytes(parts.stl(parts.box((0.0, 2.0), (0.0, 0.3), 0.0, 0.2)))
    arguments = ["geometry", "fin.stl", "--pitch-um", "200", "--nozzle-um", "500", "--out", "fin.png"]
    assert main(arguments) == 0
    text = capsys.readouterr().out
    assert "walls below 600 µm (3 cells)" in text
    assert max(map(len, text.splitlines())) <= 80
    assert (tmp_path / "fin.png").exists()


def test_open_mesh_is_described_before_it_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "open.stl").write_bytes(parts.stl(parts.box((0.0, 3.0), (0.0, 4.0), 0.0, 1.0)[2:]))
    assert main(["geometry", str(tmp_path / "open.stl"), "--pitch-um", "200"]) == 1
    shown = capsys.readouterr()
    assert "not watertight: 1 hole" in shown.out
    assert "5 mm across at (1.5, 2, 1) mm" in shown.out
    assert "mend the mesh" in shown.err


def test_assumed_unit_is_named_and_a_part_too_wide_for_memory_is_refused_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    mesh = tmp_path / "part.stl"
    mesh.write_bytes(parts.stl(parts.box((0.0, 2000.0), (0.0, 1000.0), 0.0, 300.0)))
    assert main(["geometry", str(mesh), "--no-pictures", "--pitch-um", "1"]) == 1
    shown = capsys.readouterr()
    assert "2000 x 1000 x 300 mm, if the unit of the file is mm: --unit" in " ".join(shown.out.split())
    for words in (
        "2000004 x 1000004 cells of 1 µm needs",
        "2000 x 1000 mm wide if its unit is mm, which is assumed; correct --unit, or take a larger",
    ):
        assert words in " ".join(shown.err.split())
    assert main(["geometry", str(mesh), "--no-pictures", "--pitch-um", "100", "--unit", "um"]) == 0
    assert "if the unit" not in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == [mesh], "no picture was asked for"


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["absent.stl"], "absent.stl: cannot be read: No such file"),
        (["absent.toml"], "absent.toml: 1 error"),
        (["map.csv"], "map.csv"),
        ([str(BRACKET), "--pitch-um", "0"], "--pitch-um is 0; expected a length above 0"),
        ([str(SCENARIOS / "bracket.toml"), "--unit", "mm"], "--unit: goes with the file of a part"),
    ],
)
def test_bad_arguments_are_refused_by_name(
    arguments: list[str], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["geometry", *arguments]) == 1
    assert expected in capsys.readouterr().err


@pytest.mark.parametrize(
    ("file", "size_um"), [("bracket.stl", (4000.0, 3000.0, 228.0)), ("two-inks.3mf", (4800.0, 2700.0, 76.0))]
)
def test_new_scenario_for_a_file_is_valid_and_holds_the_part(
    file: str, size_um: tuple[float, float, float], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if file.endswith(".3mf"):
        pytest.importorskip("lib3mf", reason="3MF needs lib3mf: pip install 'inkloop[3mf]'")
    monkeypatch.chdir(tmp_path)
    assert main(["new", "mine", "--part", str(SCENARIOS / "parts" / file)]) == 0
    scenario = Scenario.load("mine.toml")
    box = scenario.solid.bounds
    found = (box.x_max - box.x_min, box.y_max - box.y_min, scenario.solid.shape.height)
    assert [side * 1e6 for side in found] == pytest.approx(size_um, rel=1e-5, abs=0.0)
    mask = scenario.job().mask
    assert not mask[:2].any()
    assert not mask[:, -2:].any()
    assert max(mask.shape) >= 40
    text = Path("mine.toml").read_text()
    assert ('# "letters" = "A"' in text) == (file == "two-inks.3mf")
    assert main(["new", "mine", "--part", "absent.stl"]) == 1


BRIDGE = """shape = "combine"
op = "difference"
parts = [
    { shape = "cuboid", size_x_um = 600.0, size_y_um = 400.0, height_um = 38.0 },
    { shape = "cuboid", size_x_um = 200.0, size_y_um = 400.0, height_um = 19.0 },
]
[support]
kind = "%s"
margin_cells = 1"""
"""6 x 4 cells, 38 µm high, with a way of 2 x 4 cells and 19 µm below."""


@pytest.mark.parametrize(
    ("kind", "words", "cells", "um"),
    [
        ("below-overhangs", "1.52 nl of ink B below overhangs, on 8 cells", 8, 8 * 19),
        ("around", "38 nl of ink B around the part, on 104 cells", 12 * 10 - 6 * 4 + 8, 96 * 38 + 8 * 19),
        ("none", "none, 1.52 nl that hang on 8 cells are not printed", 8, 8 * 19),
    ],
)
def test_support_is_told_with_its_cells_and_its_volume(
    kind: str, words: str, cells: int, um: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = with_part(BRIDGE % kind, tmp_path)
    report = PartReport.of(scenario, None)
    assert f"support        {words}" in report.lines()
    volume_nl = pytest.approx(um * 100**2 * 1e-6, rel=1e-6, abs=0.0)
    assert report.data()["support"] == {"kind": kind, "cells": cells, "nl": volume_nl}
    (tmp_path / "bridge.toml").write_text(scenario.text)
    assert main(["validate", str(tmp_path / "bridge.toml")]) == 0
    assert f"; support: {words}; " in capsys.readouterr().out


def test_part_that_needs_no_support_has_no_line_of_one(tmp_path: Path) -> None:
    block = 'shape = "cuboid"\nsize_x_um = 300.0\nsize_y_um = 300.0\nheight_um = 38.0\n[support]\nkind = "{}"'
    for kind in ("below-overhangs", "none"):
        report = PartReport.of(with_part(block.format(kind), tmp_path), None)
        assert report.data()["support"] is None
        assert not [line for line in report.lines() if line.startswith("support")]


@pytest.mark.parametrize("height", [4.0, 8.0])
def test_new_scenario_for_a_tall_part_with_an_overhang_has_room_and_support(
    height: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    leg = parts.box((0.0, 1.0), (0.0, 1.0), 0.0, height - 1.0)
    table = np.concatenate([leg, parts.box((-1.0, 2.0), (-1.0, 2.0), height - 1.0, height)])
    (tmp_path / "table.stl").write_bytes(parts.stl(table))
    assert main(["new", str(tmp_path / "mine"), "--part", str(tmp_path / "table.stl"), "--pitch-um", "250"]) == 0
    mine = tmp_path / "mine.toml"
    said = f"it overhangs: [support] in {mine} adds ink B below; `inkloop geometry {mine}` says how much"
    assert said in capsys.readouterr().out
    tables = Scenario.load(mine).tables
    assert tables.support is not None
    assert tables.support.kind == "below-overhangs"
    assert tables.run.layers_max == 2 * int(np.ceil(1000 * height / 7.6))


WALL = """shape = "combine"
op = "union"
parts = [
    { shape = "cuboid", size_x_um = 600.0, size_y_um = 600.0, height_um = 30.0, center_x_um = 450.0 },
    { shape = "cuboid", size_x_um = 100.0, size_y_um = 600.0, height_um = 30.0, center_x_um = 1000.0 },
]"""


def test_figures_of_a_part_in_two_inks(tmp_path: Path) -> None:
    report = PartReport.of(with_part(TWO_INKS, tmp_path), None)
    lines = list(report.lines())
    grid = report.scenario.tables.grid
    assert lines[0] == f"grid           {grid.nx} x {grid.ny} cells of 100 µm, 40 printed"
    volume_mm3 = (16 * 30 + 24 * 20) * 100**2 * 1e-9
    assert f"volume         {volume_mm3:.5g} mm3 on these cells" in lines
    droplets = [round(cells * um / 7.6) for cells, um in ((16, 30), (24, 20))]
    inks = [line for line in lines if line.startswith("ink ")]
    assert inks == [
        f"ink A          4.8 nl, about {droplets[0]} droplets", f"ink B          4.8 nl, about {droplets[1]} droplets",
    ]  # fmt: skip
    assert "narrow         nothing: no wall, no gap below 200 µm" in lines
    assert report.size_line == "size           0.8 x 0.6 x 0.03 mm"
    data = report.data()
    assert data["ink_nl"] == pytest.approx({"A": 4.8, "B": 4.8}, rel=1e-6, abs=0.0)
    assert (data["cells_printed"], data["droplets"]) == (40, {"A": droplets[0], "B": droplets[1]})
    assert data["height_mm"] == pytest.approx(0.03, rel=1e-6, abs=0.0)
    assert data["volume_mm3"] == pytest.approx(volume_mm3, rel=1e-6, abs=0.0)
    assert data["processor_s"] == report.scenario.footprint.seconds


def test_wall_of_one_cell_is_narrow_where_it_stands(tmp_path: Path) -> None:
    scenario = with_part(WALL, tmp_path)
    report = PartReport.of(scenario, None)
    assert set(report.narrow) == {"walls"}
    walls = report.narrow["walls"]
    assert walls.cells.sum() == 6
    assert len(set(np.argwhere(walls.cells)[:, 0])) == 1  # one row along y
    assert "narrow         walls below 200 µm (2 cells): 6 cells," in report.lines()
    assert report.data()["narrow"]["walls"]["cells"] == 6
    assert report.data()["narrow_below_cells"] == 2
    wide = PartReport.of(scenario, 301e-6)
    assert wide.cells_min == 4
    assert set(wide.narrow) == {"walls", "gaps"}  # the gap of two cells between them
    assert wide.narrow["gaps"].cells.sum() == 12
    assert [PartReport.of(scenario, nozzle).cells_min for nozzle in (300e-6, 13 * 1e-4)] == [3, 13]


@pytest.mark.parametrize(
    ("layers", "words"), [(500, ""), (501, "; to try it: a smaller scale, or run.layers_max = 20")]
)
def test_print_of_many_layers_is_tried_in_small(layers: int, words: str, tmp_path: Path) -> None:
    block = f'shape = "cuboid"\nsize_x_um = 300.0\nsize_y_um = 300.0\nheight_um = {7.6 * layers}'
    lines = list(PartReport.of(with_part(block, tmp_path), None).lines())
    assert f"layers         about {layers}{words}" in lines


def test_heights_between_the_same_ends_are_searched_once(tmp_path: Path) -> None:
    """A staircase: every height is searched by hand, the report looks at one of each step."""
    stairs = 'shape = "staircase"\nsize_x_um = 800.0\nsize_y_um = 300.0\nsteps = 4\nheight_um = 152.0'
    searched: list[float] = []
    report = PartReport.of(with_part(stairs, tmp_path), 350e-6, lambda heights: searched.extend(heights) or heights)
    assert len(searched) == 4
    levels = (np.arange(21) + 0.5) / 21 * report.part.height
    walls, _ = narrow_across(report.part, 4, levels.tolist())
    assert walls is not None
    np.testing.assert_array_equal(report.narrow["walls"].cells, walls.cells)
    assert report.narrow["walls"].first == walls.first


@pytest.mark.parametrize(
    ("options", "seconds"),
    [("scan_duration_s = 2.5", 2.5), ("", 6.0), ("scan_duration_s = 2.5\nnoise_std_um = 1", 2.5)],
)
def test_time_is_that_of_layers_and_scans(options: str, seconds: float, tmp_path: Path) -> None:
    text = with_part('shape = "cuboid"\nsize_x_um = 600.0\nsize_y_um = 600.0\nheight_um = 30.4', tmp_path).text
    profiler = text.replace('kind = "ProfileSensor"\n', f'kind = "ProfileSensor"\n{options}\n')
    profiler = profiler.replace('kind = "LayerDeposition"\n', 'kind = "LayerDeposition"\nlayer_duration_s = 1.5\n')
    report = PartReport.of(type(with_part(TWO_INKS, tmp_path)).of_text(profiler, str(tmp_path / "part.toml")), None)
    assert report.scan_time == pytest.approx(report.scenario.footprint.layers * (seconds + 1.5), rel=1e-9, abs=0.0)


def test_mesh_is_described_with_its_holes() -> None:
    holes = [Hole(4, (1e-3, 2e-3, 3e-3), 5e-3), Hole(7, (0.0, 0.0, 1e-3), 2e-3, is_seam=True)]
    mesh = MeshReport(1, 1234, (3e-3, 4e-3, 1e-3), holes, ("bar",), "mm")
    assert list(mesh.lines()) == [
        "mesh           1 body, 1,234 triangles",
        "size           3 x 4 x 1 mm, if the unit of the file is mm: --unit",
        "surface        not watertight: 1 hole and 1 seam, the largest",
        "               5 mm across at (1, 2, 3) mm",
        "               2 mm across at (0, 0, 1) mm, a seam",
        "               (seam: no face is missing, but one side of it is turned over)",
    ]
    one = MeshReport(2, 12, (3e-3, 4e-3, 1e-3), holes[:1], ("bar", "foot"))
    assert list(one.lines())[2:4] == ["objects        bar, foot", "surface        not watertight: 1 hole"]
    assert not any("seam" in line for line in one.lines())
    assert list(MeshReport(1, 1, (0.0, 0.0, 0.0), [], ()).lines())[-1] == "surface        watertight"
    many = MeshReport(1, 1, (0.0, 0.0, 0.0), [holes[0]] * 12, ())
    assert sum("across" in line for line in many.lines()) == 10
    data = many.data()
    assert (data["hole_count"], len(data["holes"]), data["watertight"]) == (12, 10, False)
    assert data["holes"][0] == {
        "size_mm": pytest.approx(5.0, rel=1e-9, abs=0.0),
        "center_mm": pytest.approx([1.0, 2.0, 3.0], rel=1e-9, abs=0.0),
        "edges": 4, "seam": False,
    }  # fmt: skip
    corners = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 2, 0]], [[0, 0, 0], [1, 0, 0], [0, 0, 3]]])
    found = MeshReport.of([Body(corners, name="a"), Body(corners + 1.0, material="b"), Body(corners, name="a")])
    assert (found.bodies, found.triangles, found.size, found.names) == (3, 6, (2.0, 3.0, 4.0), ("a", "b"))


@pytest.mark.usefixtures("coarse_view")
def test_picture_of_a_part_shows_top_narrow_cells_and_the_inks_of_its_cut(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    figures: list[Figure] = []
    monkeypatch.setattr(plot, "save", lambda figure, path, formats: figures.append(figure) or [path])
    report = PartReport.of(with_part(WALL, tmp_path), None)
    assert part_picture.draw(report, "bracket", tmp_path / "x", ("png",)) == [tmp_path / "x"]
    figure = figures[0]
    assert figure.get_suptitle() == "bracket"
    above, solid, cut, _ = figure.axes
    assert [axes.get_title().partition(",")[0] for axes in (above, solid, cut)] == [
        "from above", "solid", "cut along the dashed line",
    ]  # fmt: skip
    tops: Any = np.ma.filled(np.ma.asarray(above.get_images()[0].get_array()), np.nan)
    mask = report.scenario.job().mask
    np.testing.assert_array_equal(np.isfinite(tops), mask.T)
    assert np.nanmax(tops) == np.nanmin(tops) == pytest.approx(30.0, rel=1e-6, abs=0.0)
    narrow: Any = np.ma.filled(np.ma.asarray(above.get_images()[1].get_array()), np.nan)
    np.testing.assert_array_equal(np.isfinite(narrow), report.narrow["walls"].cells.T)
    grid = report.scenario.tables.grid
    extent = (-0.05, grid.nx * 0.1 - 0.05, -0.05, grid.ny * 0.1 - 0.05)
    assert [image.get_extent() for image in above.get_images()] == [pytest.approx(extent, rel=1e-9, abs=0.0)] * 2
    legend: Any = above.get_legend()
    assert [text.get_text() for text in legend.get_texts()] == ["narrow"]
    (row,) = {float(y) * 10.0 for y in np.asarray(above.lines[0].get_ydata(), float)}
    assert mask[:, round(row)].any()
    assert row == pytest.approx(float(np.flatnonzero(mask.any(axis=0)).mean()), abs=0.51)
    assert (above.get_xlabel(), above.get_ylabel()) == ("x [mm]", "y [mm]")
    (image,) = cut.get_images()
    shown = np.asarray(image.get_array())
    np.testing.assert_array_equal(shown, np.broadcast_to(1.0 * mask[:, round(row)], shown.shape))
    assert image.get_extent() == pytest.approx((*extent[:2], 0.0, 30.0), rel=1e-6, abs=0.0)
    assert (cut.get_xlabel(), cut.get_ylabel()) == ("x [mm]", "z [µm]")
    assert figure.axes[3].get_ylabel() == "top [µm]"

    wide = PartReport.of(with_part(WALL, tmp_path), 301e-6)
    part_picture.draw(wide, "wide", tmp_path / "z", ("png",))
    narrow = np.ma.filled(np.ma.asarray(figures.pop().axes[0].get_images()[1].get_array()), np.nan)
    both = wide.narrow["walls"].cells | wide.narrow["gaps"].cells
    assert both.sum() > wide.narrow["walls"].cells.sum()
    np.testing.assert_array_equal(np.isfinite(narrow), both.T)

    two = PartReport.of(with_part(TWO_INKS, tmp_path), None)
    part_picture.draw(two, "two", tmp_path / "y", ("png",))
    above, _, cut, _ = figures[1].axes
    assert above.get_legend() is None
    (image,) = cut.get_images()
    colours = image.to_rgba(np.ma.asarray(image.get_array()))
    columns = np.flatnonzero(two.scenario.job().mask.any(axis=1))
    assert same_color(colours[10, columns[0]], plot.MATERIAL_COLOURS(1))
    assert same_color(colours[10, columns[-1]], plot.MATERIAL_COLOURS(2))
    assert colours[-1, columns[-1], 3] == 0.0  # B is lower


@pytest.mark.usefixtures("coarse_view")
@pytest.mark.parametrize(
    ("height_um", "upright", "title"),
    [(30.0, SOLID_UPRIGHT, "solid, height x 4.5"), (240.0, 0.8, "solid"), (600.0, 1.0, "solid, height x 0.5")],
)
def test_solid_fills_its_picture_and_is_as_high_as_wide_at_most(
    height_um: float, upright: float, title: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[tuple[tuple[int, ...], float]] = []

    def kept(filled: Any, upright: float) -> Any:
        shown.append((filled.shape, upright))
        return view(filled, upright)

    monkeypatch.setattr(part_picture, "view", kept)
    block = f'shape = "cuboid"\nsize_x_um = 300.0\ncenter_x_um = 600.0\nsize_y_um = 200.0\nheight_um = {height_um}'
    axes = Figure().subplots()
    part_picture._solid(axes, PartReport.of(with_part(block, tmp_path), None).part)
    ((shape, found),) = shown
    assert shape[:2] == (3, 2)
    assert found == pytest.approx(upright, rel=1e-6, abs=0.0)
    assert axes.get_title() == title


NX, NY, PITCH = 12, 10, 1e-4


def boxes_of(*boxes: tuple[slice, slice, float, float]) -> Columns:
    """Cells of slices along x and y, from a bottom to a top [um]."""
    whole = Columns(NX, NY, PITCH, np.zeros(NX * NY + 1, np.int64), np.zeros(0), np.zeros(0))
    cells = np.arange(NX * NY).reshape(NX, NY)
    for x, y, bottom, top in boxes:
        cell = cells[x, y].ravel()
        ends = (np.full(cell.size, z * 1e-6) for z in (bottom, top))
        whole |= Columns.of_intervals(NX, NY, PITCH, cell, *ends)
    return whole


def marked(found: Narrow | None) -> set[tuple[int, int]]:
    return set() if found is None else {(int(i), int(j)) for i, j in np.argwhere(found.cells)}


def test_single_row_and_single_gap_are_found() -> None:
    wide, fin = (slice(1, 5), slice(1, 6), 0.0, 30.0), (slice(6, 7), slice(1, 6), 0.0, 60.0)
    walls, gaps = narrow_across(boxes_of(wide, fin), 2, [15e-6, 45e-6])
    assert marked(walls) == {(6, j) for j in range(1, 6)}
    assert marked(gaps) == {(5, j) for j in range(1, 6)}
    assert walls
    assert walls.first == (6 * PITCH, 1 * PITCH, 15e-6)
    assert gaps
    assert gaps.first == (5 * PITCH, 1 * PITCH, 15e-6)


def test_gap_to_the_edge_of_the_grid_is_none_and_a_limit_of_cells_counts() -> None:
    block = (slice(1, 11), slice(1, 4), 0.0, 30.0)
    assert [marked(each) for each in narrow_across(boxes_of(block), 2, [15e-6])] == [set(), set()]
    assert narrow_across(boxes_of(block), 3, [15e-6]) == (None, None), "three cells are not fewer than three"
    walls, gaps = narrow_across(boxes_of(block), 4, [15e-6])
    assert marked(walls) == {(i, j) for i in range(1, 11) for j in range(1, 4)}
    assert gaps is None


def test_what_is_lower_than_a_layer_is_found() -> None:
    low, over = (slice(1, 4), slice(1, 4), 0.0, 30.0), (slice(2, 3), slice(2, 3), 34.0, 50.0)
    sheets, slots = narrow_upright(boxes_of(low, over, (slice(5, 6), slice(5, 6), 0.0, 5.0)), 7.6e-6)
    assert marked(sheets) == {(5, 5)}
    assert marked(slots) == {(2, 2)}
    assert slots
    assert np.isclose(slots.first[2], 30e-6, rtol=1e-9, atol=0.0)
    assert narrow_upright(boxes_of(low), 7.6e-6) == (None, None)
    cell = slice(2, 3), slice(2, 3)
    assert narrow_upright(boxes_of((*cell, 0.0, 8.0), (*cell, 16.0, 24.0)), 8e-6) == (None, None), (
        "as high as the limit"
    )


def test_columns_are_of_one_piece_where_neighbours_share_a_height() -> None:
    def at(i: int, j: int, bottom: float, top: float) -> tuple[slice, slice, float, float]:
        return slice(i, i + 1), slice(j, j + 1), bottom, top

    end_and_begin_of_rows = at(0, NY - 1, 0.0, 10.0), at(1, 0, 0.0, 10.0)
    assert _pieces(boxes_of(*end_and_begin_of_rows)) == 2
    assert _pieces(boxes_of(at(3, 3, 0.0, 10.0), at(4, 3, 10.0, 20.0))) == 2
    assert _pieces(boxes_of(at(6, 6, 20.0, 30.0), at(7, 6, 0.0, 5.0), at(7, 6, 20.0, 30.0))) == 2
