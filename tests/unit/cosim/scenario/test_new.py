"""A scenario from `inkloop new` prints as it is and names every table; those of inkloop are known by name."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import pytest
import tomlkit

import inkloop
from inkloop.cli import main
from inkloop.commands.parts import SHAPES
from inkloop.printing.run import print_part
from inkloop.scenario import new, packaged
from inkloop.scenario.file import Scenario
from inkloop.scenario.part_file import PartFile
from inkloop.scenario.part_grid import fit
from inkloop.scenario.validation import EMPTY_CELLS
from inkloop.tables.schema import ScenarioFile
from support import meshes
from support.places import SCENARIOS
from support.prints import LITTLE_WORK


@pytest.mark.system
@pytest.mark.parametrize("shape", new.shapes())
def test_template_prints_until_its_controller_is_done(shape: str, tmp_path: Path) -> None:
    assert main(["new", str(tmp_path / "mine"), "--shape", shape]) == 0
    result = print_part(Scenario.load(tmp_path / "mine.toml", dict(LITTLE_WORK)))
    assert result.stop_reason == "done"
    assert abs(result.metrics()["mean_error"]) < 1e-6


def test_every_shape_without_a_file_has_a_template() -> None:
    part = ScenarioFile.model_json_schema()["properties"]["part"]
    assert set(part["discriminator"]["mapping"]) - {"mesh", "stack", "layers", "height-map"} == set(new.shapes())


def test_command_line_offers_every_template() -> None:
    assert list(SHAPES) == new.shapes()


@pytest.mark.parametrize("shape", new.shapes())
def test_every_table_is_in_the_template(shape: str, tmp_path: Path) -> None:
    text = new.write(tmp_path / "mine", shape).read_text()
    heads = {head.split(".")[0] for head in re.findall(r"^(?:# )?\[+([\w.]+)", text, re.MULTILINE)}
    values = {"schema_version", "title", "label", "seed", "buses"}  # buses are of FMUs that a template has none of
    assert heads == set(ScenarioFile.model_fields) - values


@pytest.mark.parametrize("shape", new.shapes())
def test_tables_that_are_comments_are_valid_when_they_are_switched_on(shape: str, tmp_path: Path) -> None:
    path = new.write(tmp_path / "mine", shape)
    head, separator, tables = path.read_text().partition("[grid]")
    switched = re.sub(r"^# (?=[\w\[])", "", tables, flags=re.MULTILINE)
    path.write_text(head + separator + switched)
    Scenario.load(path)


def test_new_overwrites_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine.toml").write_text("mine")
    assert main(["new", str(tmp_path / "mine")]) == 1
    assert "not overwritten" in capsys.readouterr().err
    assert (tmp_path / "mine.toml").read_text() == "mine"


@pytest.mark.parametrize(("name", "title"), [("my-part_two", "My part two"), ('the "A"', "The 'a'"), ("x.toml", "X")])
def test_title_is_the_name_in_words(name: str, title: str, tmp_path: Path) -> None:
    assert tomlkit.parse(new.write(tmp_path / name, "cuboid").read_text())["title"] == title


def test_classes_of_a_folder_are_found_within_the_block_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Unless the folder was searched before."""
    monkeypatch.setattr(sys, "path", before := ["elsewhere"])
    for found in (["elsewhere"], ["elsewhere", str(tmp_path)]):
        before[:] = found
        with packaged.classes_from(tmp_path):
            assert before == ["elsewhere", str(tmp_path)]
        assert before == found


@pytest.mark.parametrize("cells", [3, 6, 7, 12, 24])
def test_part_of_whole_cells_gets_no_cell_more_by_rounding(cells: int, tmp_path: Path) -> None:
    """Its sides are 100 um each in mm, of which most have no exact double."""
    path = tmp_path / "part.stl"
    path.write_bytes(meshes.binary_stl(meshes.box((0, 0, 0), (cells / 10, (cells + 1) / 10, 0.2))))
    grid = fit(PartFile(path), 100.0).grid
    assert (grid.nx, grid.ny) == (cells + 2 * EMPTY_CELLS, cells + 1 + 2 * EMPTY_CELLS)


def test_packaged_scenarios_are_those_of_the_folder() -> None:
    assert set(packaged.scenarios()) == {path.stem for path in SCENARIOS.glob("*.toml")}


def test_list_names_every_scenario_with_its_title(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new", "--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(packaged.scenarios()) > 20
    assert next(line for line in lines if line.startswith("cuboid")).split(maxsplit=1)[1] == packaged.titles()["cuboid"]
    assert max(map(len, lines)) <= 80
    assert main(["new", "--list", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["scenarios"] == packaged.titles()


def test_name_means_the_packaged_scenario_where_no_file_has_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["validate", "bracket"]) == 0  # with the file of its part
    assert packaged.resolve(Path("cuboid")) == packaged.scenarios()["cuboid"]
    assert inkloop.load("cuboid").tables == Scenario.load(SCENARIOS / "cuboid.toml").tables
    assert main(["geometry", "cuboid", "--no-pictures"]) == 0
    for other in ("cuboid.toml", "folder/cuboid"):
        assert packaged.resolve(Path(other)) == Path(other)
    Path("cuboid").mkdir()
    assert packaged.resolve(Path("cuboid")) == Path("cuboid")
    capsys.readouterr()
    for command in ("validate", "geometry"):
        assert main([command, "cubiod"]) == 1
        assert "neither a file nor a scenario of inkloop; did you mean cuboid?" in capsys.readouterr().err
    assert main(["new"]) == 1
    assert "--list" in capsys.readouterr().err
    Path("mine.toml").touch()
    assert main(["validate", "mine"]) == 1
    assert "did you mean mine.toml?" in capsys.readouterr().err
