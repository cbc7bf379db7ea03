"""`inkloop geometry` says of a part what another computation finds, and draws it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tools import parts

from inkloop.cli import main
from inkloop.geometry.body import Body
from inkloop.report.part_flaws import holes
from inkloop.report.part_report import MeshReport, PartReport
from inkloop.scenario.file import Scenario
from support.parts import TWO_INKS, with_part
from support.places import SCENARIOS

BRACKET = SCENARIOS / "parts" / "bracket.stl"


def test_watertight_bodies_have_no_hole_and_a_missing_face_is_one() -> None:
    bracket = parts.bracket()
    assert holes([Body(bracket)]) == []
    box = parts.box((0.0, 3.0), (0.0, 4.0), 0.0, 1.0)
    without_top = box[2:]  # the first two triangles are the upper face
    (hole,) = holes([Body(bracket + 100.0), Body(without_top)])
    assert hole.edges == 4
    assert hole.center == (1.5, 2.0, 1.0)
    assert hole.size == pytest.approx(5.0, rel=1e-12, abs=0.0)


def test_faces_turned_over_are_seams_and_no_holes() -> None:
    box = parts.box((0.0, 3.0), (0.0, 4.0), 0.0, 1.0)
    turned = np.concatenate([box[:2, ::-1], box[2:]])  # the upper face points down
    (seam,) = holes([Body(turned)])
    assert (seam.edges, seam.is_seam) == (4, True)
    both = MeshReport.of([Body(turned), Body(box[2:] + 100.0)])
    assert sorted(hole.is_seam for hole in both.holes) == [False, True]
    assert "surface        not watertight: 1 hole and 1 seam, the largest" in both.lines()


def test_holes_come_with_the_largest_first() -> None:
    box = parts.box((0.0, 3.0), (0.0, 4.0), 0.0, 1.0)
    sizes = [hole.size for hole in holes([Body(box[1:]), Body(box[1:] * 3.0 + 50.0), Body(box[1:] * 2.0 - 50.0)])]
    assert sizes == sorted(sizes, reverse=True)
    assert len(sizes) == 3


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
    assert found["layers"] == int(np.ceil(228 / 7.6))
    assert found["droplets"]["A"] == pytest.approx(found["volume_mm3"] * 1e9 / (100.0**2 * 7.6), abs=1.0)
    assert found["narrow"] == {}
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


def test_ink_of_two_inks_is_that_of_the_columns(tmp_path: Path) -> None:
    volumes = PartReport.of(with_part(TWO_INKS, tmp_path), None).volumes
    assert volumes["A"] * 1e18 == pytest.approx(4 * 4 * 100**2 * 30, rel=1e-6, abs=0.0)
    assert volumes["B"] * 1e18 == pytest.approx(4 * 6 * 100**2 * 20, rel=1e-6, abs=0.0)


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


@pytest.mark.parametrize("height", [4.0, 8.0])
def test_new_scenario_for_a_tall_part_with_an_overhang_has_room_and_support(height: float, tmp_path: Path) -> None:
    leg = parts.box((0.0, 1.0), (0.0, 1.0), 0.0, height - 1.0)
    table = np.concatenate([leg, parts.box((-1.0, 2.0), (-1.0, 2.0), height - 1.0, height)])
    (tmp_path / "table.stl").write_bytes(parts.stl(table))
    assert main(["new", str(tmp_path / "mine"), "--part", str(tmp_path / "table.stl"), "--pitch-um", "250"]) == 0
    tables = Scenario.load(tmp_path / "mine.toml").tables
    assert tables.support is not None
    assert tables.support.kind == "below-overhangs"
    assert tables.run.layers_max == 2 * int(np.ceil(1000 * height / 7.6))
