"""Inks in separate files: what a scenario takes from one, and what is refused with a message."""

from __future__ import annotations

from pathlib import Path

import pytest

from inkloop.errors import ScenarioError
from inkloop.scenario.file import Scenario

INK = """
[a]
h1_um = 5.0
h2_um = 0.5
h3_um = 0.1

[models.VolumeAreaDeposition]
height_scale_um = 7.5
mv_plus_per_um = 0.005
guard = true

[identified]
noise_um = 0.3
"""
SCENARIO = """
title = "An ink of its own"
[grid]
nx = 8
ny = 8
[part]
shape = "cuboid"
size_x_um = 1000.0
size_y_um = 1000.0
height_um = 20.0
[ink]
file = "inks/mine.toml"
[components.controller]
kind = "OpenLoop"
[components.printer]
kind = "VolumeAreaDeposition"
[components.profiler]
kind = "ProfileSensor"
"""


def write(folder: Path, ink: str = INK, scenario: str = SCENARIO) -> Path:
    (folder / "inks").mkdir(exist_ok=True)
    (folder / "inks" / "mine.toml").write_text(ink)
    (folder / "print.toml").write_text(scenario)
    return folder / "print.toml"


def test_values_of_the_scenario_override_the_ink_file(tmp_path: Path) -> None:
    own = SCENARIO.replace("[components.controller]", "[ink.a]\nh2_um = 0.7\n[components.controller]")
    own = own.replace('"VolumeAreaDeposition"', '"VolumeAreaDeposition"\nmv_plus_per_um = 0.004\nguard = false')
    scenario = Scenario.load(write(tmp_path, scenario=own))
    assert scenario.job().inks[0].h2 == pytest.approx(0.7e-6, rel=1e-9, abs=0.0)
    assert scenario.job().inks[0].h1 == pytest.approx(5.0e-6, rel=1e-9, abs=0.0)
    assert scenario.tables.components["printer"].options == {
        "mv_plus_per_um": 0.004,
        "guard": False,
        "height_scale_um": 7.5,
    }


@pytest.mark.parametrize(
    ("ink", "message"),
    [
        (INK.replace("h3_um = 0.1\n", ""), "a.h3_um is missing"),
        (INK.replace("h1_um = 5.0", "h1_um = -5.0"), "a.h1_um is -5.0"),
        (INK.replace("h1_um", "h1_mm"), "h1_mm is in mm; write h1_um = 5000"),
        ("[a\n", "is not TOML"),
        (INK.replace("height_scale_um = 7.5", "height = 7.5"), "components.printer.height"),
    ],
)
def test_impossible_ink_is_refused_with_a_message(ink, message, tmp_path: Path) -> None:
    with pytest.raises(ScenarioError) as caught:
        Scenario.load(write(tmp_path, ink))
    assert message in str(caught.value)


def test_ink_file_that_is_not_there_and_other_errors_are_named_at_once(tmp_path: Path) -> None:
    path = write(tmp_path, scenario=SCENARIO.replace("mine.toml", "yours.toml").replace("nx = 8", "nx = 0"))
    with pytest.raises(ScenarioError, match="2 errors") as caught:
        Scenario.load(path)
    assert "ink.file is 'inks/yours.toml'" in str(caught.value)
    assert "grid.nx is 0" in str(caught.value)


def test_second_ink_and_models_of_comparison_runs_come_from_the_file_too(tmp_path: Path) -> None:
    compared = '[compare.other.components.printer]\nkind = "VolumeAreaDeposition"\nguard = false\n'
    scenario = Scenario.load(write(tmp_path, INK + "[b]\nh1_um = 4.0\nh2_um = 0.4\nh3_um = 0.2\n", SCENARIO + compared))
    assert [ink.h1 for ink in scenario.job().inks] == pytest.approx([5.0e-6, 4.0e-6], rel=1e-9, abs=0.0)
    options = scenario.tables.compare["other"].components["printer"].options
    assert options == {"height_scale_um": 7.5, "mv_plus_per_um": 0.005, "guard": False}


@pytest.mark.parametrize("overrides", [{}, {"ink.file": "inks/mine.toml"}])
def test_scenario_takes_the_ink_of_a_file_next_to_it_into_its_text(overrides: dict[str, str], tmp_path: Path) -> None:
    """So that a later change of the ink file changes no run."""
    text = SCENARIO.replace('[ink]\nfile = "inks/mine.toml"\n', "") if overrides else SCENARIO
    scenario = Scenario.load(write(tmp_path, scenario=text), overrides)
    (tmp_path / "inks" / "mine.toml").unlink()
    for found in (scenario, Scenario.of_text(scenario.text, str(tmp_path / "print.toml"))):
        (ink,) = found.job().inks
        assert (ink.h1, ink.h2, ink.h3) == pytest.approx((5.0e-6, 0.5e-6, 0.1e-6), rel=1e-9, abs=0.0)
        options = found.tables.components["printer"].options
        assert options == {"height_scale_um": 7.5, "mv_plus_per_um": 0.005, "guard": True}
    assert "\nfile =" not in scenario.text
    assert overrides or "from inks/mine.toml" in scenario.text
