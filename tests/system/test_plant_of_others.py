"""A plant of another tool prints after `inkloop new --plant` and one edit."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from inkloop.cli import main
from inkloop.errors import ScenarioError
from inkloop.fmu import FmuDescription, Variable, describe
from inkloop.fmu_writer.export import find_fmu
from inkloop.results.result import Result
from inkloop.scenario.plant_file import Plant, plant_of, text_for_plant
from inkloop.units import defined_unit
from support.fmus import amplifier, rows_plant

TEMPLATE = "[grid]\nnx = 16\nny = 16\n# {part}\n[components.printer]\n[components.profiler]\n"
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
    assert result.metrics()["mae"] < 1.1e-6  # 1.01e-6 at best: a droplet is 6.08 um high


def test_what_an_fmu_does_not_state_is_assumed_and_said(desk: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows_plant.build(desk, has_units=False)
    assert main(["info", "rows.fmu"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "inputs Bed.row0.Drop_0 to Bed.row7.Drop_11 (96) Real = 0" in shown
    assert "as a plant: droplets into Bed.row{i}.Drop_{j}, surface from Bed.row{i}.Level_{j}, on 12 x 8 cells" in shown
    assert main(["new", "theirs", "--plant", "rows.fmu"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "12 x 8 cells" in shown
    assert "Bed.row{i}.Drop_{j} is 1 for a droplet; Bed.row{i}.Level_{j} is in um" in shown
    assert (ports()["pattern"]["gain"], ports()["height"]["unit"]) == (1.0, "um")
    assert main(["validate", "theirs.toml", "--quiet"]) == 0


def test_fmu_without_maps_is_refused_with_what_it_has(desk: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one = amplifier.altered(amplifier.build(desk, 3), desk / "one.fmu", ('start="3"', 'start="1"'))
    assert main(["new", "theirs", "--plant", str(one)]) != 0
    told = " ".join(capsys.readouterr().err.split())
    assert "no input and output that are maps of one grid (inputs: none; outputs: none)" in told
    assert not Path("theirs.toml").exists()


def described(way: str, name: str, shape: tuple[int, int] = (2, 3), unit: str = "1") -> list[Variable]:
    """Scalars of a plant; {i} and {j} in the name, from 0."""
    return [
        Variable(name.format(i=i, j=j), "Real", way, "continuous", (1,), unit=unit)
        for i in range(shape[0])
        for j in range(shape[1])
    ]


def plant_with(*variables: Variable) -> Plant:
    named = {each.name: each for each in variables}
    return plant_of(FmuDescription(Path("it.fmu"), "It", 2, "it", "token", named, (), True, True))


def array(way: str, name: str, shape: tuple[int, ...], unit: str = "1") -> Variable:
    return Variable(name, "Float64", way, "continuous", (1,), dimensions=shape, unit=unit)


def test_names_padded_with_zeros_keep_them() -> None:
    found = plant_with(*described("input", "dose_{i:02}_{j:02}"), *described("output", "z{i:03}{j:02}", unit="mm"),
                       *described("output", "height_{i:02}_{j}", unit="mm"))  # fmt: skip
    assert (found.pattern.variable, found.height.variable) == ("dose_{i:02}_{j:02}", "height_{i:02}_{j}")
    with pytest.raises(ScenarioError, match="inputs: none"):  # digits that a template does not write
        plant_with(*(array("input", f"dose_{i}_{j}", ()) for i in "١٢" for j in "١٢"))


@pytest.mark.parametrize(
    "cells",
    [
        [(i, j) for i in (0, 1) for j in (0, 2, 3)],
        [(i, j) for i in (0, 2) for j in (0, 1)],
        [(0, 0), (0, 1), (1, 0)],
        [(i, j) for i in (0, 1) for j in (1, 2)],
    ],
)
def test_numbers_that_count_no_whole_rectangle_are_no_map(cells: list[tuple[int, int]]) -> None:
    """A gap along either axis, a cell that is missing, axes that begin with different numbers."""
    with pytest.raises(ScenarioError, match="inputs: none; outputs: z of 2 x 3"):
        plant_with(*(array("input", f"dose_{i}_{j}", ()) for i, j in cells), array("output", "z", (2, 3), "mm"))


def test_numbers_from_nought_to_ten_have_no_zeros_before_them() -> None:
    found = plant_with(*described("input", "dose_{j}", (1, 11)), array("output", "z", (11,), "mm"))
    assert (found.pattern.variable, found.pattern.first) == ("dose_{i}", 0)


def test_maps_in_two_orders_of_axes_are_one_grid() -> None:
    found = plant_with(array("input", "dose", (4, 3)), array("output", "height", (3, 4), "mm"))
    assert (found.pattern.grid, found.height.grid, found.height.rows) == ((4, 3), (4, 3), True)
    with pytest.raises(ScenarioError, match="no input and output that are maps of one grid"):
        plant_with(array("input", "dose", (4, 3)), array("output", "height", (2, 6), "mm"))


@pytest.mark.parametrize(
    ("dose", "height", "found"),
    [
        (described("input", "Drop_{j}", (1, 5)), described("output", "row0.Level_{j:02}", (1, 5), "mm"),
         ("Drop_{i}", "row0.Level_{i:02}")),
        ([array("input", "dose", (5,))], [array("output", "z", (5,), "mm")], ("dose", "z")),
        ([array("input", "dose", (5, 1))], [array("output", "z", (1, 5), "mm")], ("dose", "z")),
    ],
)  # fmt: skip
def test_one_row_is_a_profile(dose: list[Variable], height: list[Variable], found: tuple[str, str], desk: Path) -> None:
    plant = plant_with(*dose, *height)
    assert (plant.pattern.variable, plant.height.variable) == found
    assert (plant.pattern.grid, plant.height.grid) in (((5, 1), (5, 1)), ((1, 5), (1, 5)))
    written = tomllib.loads(text_for_plant(desk / "x.toml", TEMPLATE, plant))
    assert sorted(written["grid"].values()) == [1, 5]
    assert plant_with(*dose, *height, array("input", "jets", (2, 3)), array("output", "bed", (2, 3))).pattern.grid == (
        2,
        3,
    )  # a map before a profile


def test_other_maps_of_the_grid_are_listed(desk: Path) -> None:
    more = (array("input", "heat", (2, 3), "K"), array("output", "cured", (2, 3)), array("input", "wide", (4, 3)))
    plant = plant_with(*described("input", "dose_{i}_{j}"), *described("output", "z_{i}_{j}", unit="mm"), *more)
    assert (plant.pattern.variable, plant.height.variable) == ("dose_{i}_{j}", "z_{i}_{j}")
    (line,) = (row for row in text_for_plant(desk / "x.toml", TEMPLATE, plant).splitlines() if "more of these" in row)
    assert line == "# more of these maps: heat of 2 x 3 [K], cured of 2 x 3 [1]"


def test_dose_as_a_thickness_is_that_of_a_droplet(desk: Path) -> None:
    found = plant_with(array("input", "dose", (20, 10), "um"), array("output", "height", (20, 10), "mm"))
    assert not found.unstated
    written = tomllib.loads(text_for_plant(desk / "x.toml", TEMPLATE, found))
    block = [round(written["part"][f"size_{axis}_um"] / 263.256, 3) for axis in "xy"]
    assert (block, written["grid"]) == ([12.0, 6.0], {"nx": 20, "ny": 10})
    assert "gain = 7.6}   # [um] of a droplet of the default ink" in text_for_plant(desk / "x.toml", TEMPLATE, found)


def test_scalars_of_two_units_are_no_map() -> None:
    dose = [array("input", f"dose_{number}", (), "um" if number < 4 else "mm") for number in range(1, 7)]
    with pytest.raises(ScenarioError, match="inputs: none; outputs: bed of 6 x 1"):
        plant_with(*dose, array("output", "bed", (6,), "mm"))


def test_array_of_three_indices_is_no_map() -> None:
    with pytest.raises(ScenarioError, match="inputs: none; outputs: bed of 4 x 3"):
        plant_with(array("input", "dose", (4, 3, 2)), array("output", "bed", (4, 3), "mm"))


def test_map_of_another_quantity_is_no_surface() -> None:
    warm = defined_unit("degC", {"K": 1}, 1.0, 273.15)
    with pytest.raises(ScenarioError, match=r"outputs: bed of 4 x 3 \[degC\]"):
        plant_with(array("input", "dose", (4, 3)), array("output", "bed", (4, 3), warm))


@pytest.mark.parametrize("model", ["LayerController", "ProfileSensor"])
def test_controller_and_sensor_are_no_plant(model: str) -> None:
    with pytest.raises(ScenarioError, match="as a controller or a sensor; name the FMU of a printer"):
        plant_of(describe(find_fmu(model, "fmi3")))
