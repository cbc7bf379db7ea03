"""Scenarios that are installed with inkloop, by name."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from inkloop.cli import main
from inkloop.scenario import packaged
from support.places import SCENARIOS


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
    for other in ("cuboid.toml", "folder/cuboid", "nobody"):
        assert packaged.resolve(Path(other)) == Path(other)
    Path("cuboid").mkdir()
    assert packaged.resolve(Path("cuboid")) == Path("cuboid")
    capsys.readouterr()
    assert main(["validate", "cubiod"]) == 1
    assert "neither a file nor a scenario of inkloop; did you mean cuboid?" in capsys.readouterr().err
    assert main(["new"]) == 1
    assert "--list" in capsys.readouterr().err
