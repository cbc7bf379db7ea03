"""A plant and a disturbance of PythonFMU, which shares nothing with ours, under our controller, as in the tutorial."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from inkloop.cli import main
from inkloop.component import Job
from inkloop.components import catalog
from inkloop.errors import ScenarioError
from inkloop.printing.print import Print
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop.testing import RESUMABLE_CONTRACT_CHECKS, ContractCheck
from support.places import ROOT

PAGE = ROOT / "docs" / "tutorial" / "your-own-plant.md"


def files() -> dict[str, str]:
    """File name -> content, as the page shows it."""
    return dict(re.findall(r"```(?:python|toml)\n# (\S+)\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL))


def commands() -> list[str]:
    """The lines that the page has its reader type."""
    return re.findall(r"^    (pythonfmu \S.*|inkloop \S.*)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)


def build(folder: Path, script: str, text: str) -> None:
    """Export the class of a script as an FMU into the folder, as the page does it."""
    (folder / script).write_text(text, encoding="utf-8")
    flags = ["--handle-state", "--serialize-state"]
    subprocess.run([sys.executable, "-m", "pythonfmu", "build", "-f", script, *flags], cwd=folder, check=True)


def type_in(folder: Path, command: str) -> subprocess.CompletedProcess[str]:
    """A line of the page in a folder, with the programs of this environment."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    return subprocess.run(
        command.split(), cwd=folder, env={**os.environ, "PATH": path}, capture_output=True, text=True, check=False
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of the page and what its first commands make of them."""
    made = tmp_path_factory.mktemp("foreign")
    for name, text in files().items():
        (made / name).write_text(text, encoding="utf-8")
    for command in commands()[:2]:
        assert type_in(made, command).returncode == 0
    return made


@pytest.fixture(scope="module")
def tutorial(folder: Path) -> Result:
    """Output of the other commands."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for command in commands()[2:]:
            words = command.split()[1:]
            assert main([*words, "--no-isolate", "--no-pictures"] if words[0] == "run" else words) == 0
    return Result.load(folder / "runs" / "plant")


def test_commands_of_the_tutorial_print_the_part(tutorial: Result) -> None:
    metrics = tutorial.metrics()
    assert abs(metrics["mean_error"]) < 1.5e-6
    assert metrics["std"] < 2e-6
    assert tutorial.stop_reason == "done"


def test_plant_gets_what_the_disturbance_lets_through(tutorial: Result) -> None:
    """A layer rises by its droplets times the share that comes out: gains, units and the order of steps are right."""
    droplets = tutorial.dataset["pattern"].values.sum(axis=(1, 2))[1:]
    risen = np.diff(tutorial.dataset["height"].values.sum(axis=(1, 2)))
    shares = risen / (droplets * 527.0 / 69.3e6)
    assert 0.8 < shares.min() <= shares.max() <= 1.0 + 1e-9
    assert (np.diff(shares) < 1e-9).all()


def test_wrong_names_and_units_are_all_reported_at_once(folder: Path) -> None:
    text = (folder / "plant.toml").read_text(encoding="utf-8")
    for right, wrong in (
        ('"dose"', '"dosis"'),
        ('unit = "um"', 'unit = "s"'),
        ("ink.share", "ink.shar"),
        ('"exact"', '"exakt"'),
    ):
        assert right in text
        text = text.replace(right, wrong)
    (folder / "wrong.toml").write_text(text, encoding="utf-8")
    with pytest.raises(ScenarioError) as caught:
        Scenario.load(folder / "wrong.toml")
    for words in (
        "components.printer.ports.pattern.variable is 'dosis', which is no input",
        "of the FMU; did you mean dose?",
        "components.printer.ports.height.unit is 's'; needs a unit of the quantity [m]",
        "components.profiler.preset is 'exakt'",
        "ink.shar: ink has no output 'shar'; did you mean share?",
    ):
        assert words in str(caught.value)
    assert len(caught.value.errors) == 4


def test_fixed_grid_of_a_foreign_fmu_is_not_exported_by_inkloop(folder: Path) -> None:
    text = (folder / "plant.toml").read_text(encoding="utf-8").replace("nx = 10", "nx = 9")
    (folder / "grid.toml").write_text(text, encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"take the grid of the FMU, or make one that fits$"):
        Scenario.load(folder / "grid.toml")


@pytest.mark.parametrize("check", RESUMABLE_CONTRACT_CHECKS)
def test_mapped_plant_keeps(check: ContractCheck, folder: Path) -> None:
    ports = {"pattern": {"variable": "dose", "gain": 527.0}, "height": {"variable": "z", "unit": "um"}}
    job = Job(10, 10, pitch=263.256e-6, target_height=np.full((10, 10), 1e-3), mask=np.ones((10, 10), dtype=np.bool_))
    check(lambda: catalog.make("PlainPlant", job, {"file": str(folder / "Deposit.fmu"), "ports": ports}))


def test_profile_of_scalars_with_any_names_prints(tmp_path: Path) -> None:
    script = files()["deposit.py"].replace("NX, NY = 10, 10", "NX, NY = 12, 1")
    script = script.replace('f"{name}[{i + 1},{j + 1}]"', 'f"{name}_{i}"')
    script = script.replace("class Deposit", "class Wall")
    build(tmp_path, "wall.py", script)  # PythonFMU keeps one module of a name in a process
    (tmp_path / "profile.toml").write_text("""
title = "a wall, one cell wide"
grid = { nx = 12, ny = 1 }
part = { shape = "cuboid", height_um = 22.8, size_x_um = 1700.0, size_y_um = 200.0 }
[components.controller]
kind = "LayerMpc"
[components.printer]
kind = "PlainPlant"
file = "Wall.fmu"
[components.printer.ports]
pattern = { variable = "dose_{i}", first = 0, gain = 527.0 }
height = { variable = "z_{i}", first = 0, unit = "um" }
[components.profiler]
kind = "ProfileSensor"
preset = "exact"
""")
    result = Print(Scenario.load(tmp_path / "profile.toml")).run()
    assert result.stop_reason == "done"
    assert result.dataset["height"].shape[1:] == (12, 1)
    assert abs(result.metrics()["mean_error"]) < 2e-6
