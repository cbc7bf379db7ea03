"""A plant of another tool prints after `inkloop new --plant` and one edit."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from inkloop.cli import main
from inkloop.results.result import Result
from support.fmus import amplifier, rows_plant

pytestmark = [pytest.mark.system, pytest.mark.compiled, pytest.mark.usefixtures("without_pictures")]


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def ports() -> dict[str, dict[str, object]]:
    found: dict[str, dict[str, object]] = tomllib.loads(text())["components"]["printer"]["ports"]
    return found


def text() -> str:
    return Path("theirs.toml").read_text(encoding="utf-8")


def test_plant_with_rows_from_the_top_prints_after_one_edit(desk: Path) -> None:
    rows_plant.build(desk)
    assert main(["new", "theirs", "--plant", "rows.fmu", "--quiet"]) == 0
    assert ports()["height"] == {"variable": "Bed.row{i}.Level_{j}", "first": 0, "transpose": True}
    assert ports()["pattern"]["gain"] == pytest.approx(0.5267, rel=1e-3, abs=0.0)  # nl: 7.6 um on (263.256 um)^2
    assert main(["validate", "theirs.toml", "--quiet"]) == 0
    Path("theirs.toml").write_text(
        text().replace("transpose = true", 'transpose = true, mirror = "y"'), encoding="utf-8"
    )
    assert main(["run", "theirs.toml", "--out", "run", "--quiet", "--no-compare"]) == 0
    result = Result.load(desk / "run")
    assert result.dataset["height"].isel(layer=-1).shape == (rows_plant.COLUMNS, rows_plant.ROWS)
    assert result.metrics()["mae"] < 2e-6


def test_what_an_fmu_does_not_state_is_assumed_and_said(desk: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows_plant.build(desk, has_units=False)
    assert main(["new", "theirs", "--plant", "rows.fmu"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "12 x 8 cells" in shown
    assert "Bed.row{i}.Drop_{j} is 1 for a droplet; Bed.row{i}.Level_{j} is in um" in shown
    assert (ports()["pattern"]["gain"], ports()["height"]["unit"]) == (1.0, "um")
    assert main(["validate", "theirs.toml", "--quiet"]) == 0


def test_fmu_without_maps_is_refused_with_what_it_has(desk: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new", "theirs", "--plant", str(amplifier.build(desk, 3))]) != 0
    told = " ".join(capsys.readouterr().err.split())
    assert "no input and output that are maps of one grid (inputs: none; outputs: none)" in told
    assert not Path("theirs.toml").exists()
