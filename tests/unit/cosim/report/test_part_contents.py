"""Report and picture of a part before its print, worked out by hand for a block on legs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import same_color
from matplotlib.figure import Figure
from PIL import Image

from inkloop.geometry.body import Body
from inkloop.report import part_picture, pictures, plot
from inkloop.report.model_difference import LayerDifference, ModelDifference
from inkloop.report.part_flaws import Hole
from inkloop.report.part_report import MeshReport, PartReport
from inkloop.report.solid_picture import SOLID_UPRIGHT, view
from inkloop.results.result import Result
from support.parts import TWO_INKS, with_part
from support.toys import toy_result

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
    assert data["computing_s"] == pytest.approx(40 * report.scenario.footprint.seconds_of_a_cell, rel=1e-9, abs=0.0)


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
    assert PartReport.of(scenario, 300e-6).cells_min == 3


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


def test_picture_of_a_part_shows_top_narrow_cells_and_the_inks_of_its_cut(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("inkloop.report.solid_picture.PIXELS", 60)
    monkeypatch.setattr("inkloop.report.solid_picture.STEPS", 60)
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

    monkeypatch.setattr("inkloop.report.solid_picture.PIXELS", 20)
    monkeypatch.setattr("inkloop.report.solid_picture.STEPS", 20)
    monkeypatch.setattr(part_picture, "view", kept)
    block = f'shape = "cuboid"\nsize_x_um = 300.0\ncenter_x_um = 600.0\nsize_y_um = 200.0\nheight_um = {height_um}'
    axes = Figure().subplots()
    part_picture._solid(axes, PartReport.of(with_part(block, tmp_path), None).part)
    ((shape, found),) = shown
    assert shape[:2] == (3, 2)
    assert found == pytest.approx(upright, rel=1e-6, abs=0.0)
    assert axes.get_title() == title


def test_difference_has_a_row_for_each_layer_in_micrometres() -> None:
    rows = (
        LayerDifference(0, -0.001e-6, 2e-6, float("nan"), -3.5e-6, (5, 4)),
        LayerDifference(3, 1.5e-6, 4e-6, 0.25e-6, 6.25e-6, (1, 0)),
        LayerDifference(4, 1.0e-6, 3e-6, 0.5e-6, 9.0e-6, (0, 2)),
    )
    found = ModelDifference("the shadow", np.zeros((5, 6, 6)), rows)
    assert found.farthest.layer == 3
    assert found.sentence() == (
        "hardware minus the shadow (hardware higher +, lower -): farthest in layer 3, mean +1.50, rms 4.00 µm, worst "
        "cell (1, 0) +6.25 µm"
    )
    table = found.table()
    assert list(zip(*([str(cell) for cell in column.cells] for column in table.columns), strict=True)) == [
        ("0", "+0.00", "2.00", "-", "-3.50", "5, 4"),
        ("3", "+1.50", "4.00", "0.25", "+6.25", "1, 0"),
        ("4", "+1.00", "3.00", "0.50", "+9.00", "0, 2"),
    ]
    assert [str(column.header).strip() for column in table.columns] == [
        "layer", "mean", "rms", "growth", "worst", "at cell",
    ]  # fmt: skip


def test_pdf_has_summary_pictures_and_scenario_on_its_pages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pages: list[Figure] = []

    class Pages:
        """Stands for a PDF; keeps its pages."""

        def __init__(self, path: Path, metadata: object) -> None:
            self._path = path

        def __enter__(self) -> Pages:
            self._path.write_bytes(b"%PDF")
            return self

        def __exit__(self, *_: object) -> None: ...

        def savefig(self, figure: Figure) -> None:
            pages.append(figure)

    picture = Figure((1.0, 1.0))
    monkeypatch.setattr(pictures, "PdfPages", Pages)
    monkeypatch.setattr(pictures, "pictures", lambda runs: {"surface": picture})
    run, other = toy_result(), Result(toy_result().dataset.assign_attrs(scenario="another"), {})
    summary = "\n".join(["a" * 130, *[f"line {n}" for n in range(90)]])
    pictures.write_pdf(tmp_path / "report.pdf", {"main": run, "other": other}, summary)
    texts = [figure.texts[0].get_text() if figure.texts else "" for figure in pages]
    assert len(pages) == 4
    assert pages[2] is picture
    assert texts[0].split("\n")[:3] == ["a" * 120, "a" * 10, "line 0"]
    assert len(texts[0].split("\n")) == 88
    assert texts[1].split("\n") == [f"line {n}" for n in range(86, 90)]
    assert texts[3].strip() == run.scenario_text.strip()
    assert [path.name for path in tmp_path.iterdir()] == ["report.pdf"]


def test_picture_is_written_in_place_with_each_suffix(tmp_path: Path) -> None:
    figure = Figure((2.0, 1.0))
    assert plot.save(figure, tmp_path / "cut.png", ("svg", "png")) == [tmp_path / "cut.svg", tmp_path / "cut.png"]
    assert plot.save(figure, tmp_path / "run.2", ("png",)) == [tmp_path / "run.2.png"]
    with Image.open(tmp_path / "cut.png") as image:
        assert image.size == (400, 200)  # 200 dots per inch
