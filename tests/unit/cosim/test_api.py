"""The public names of `import inkloop`: print, read, and errors in terms of Python."""

from __future__ import annotations

import ast
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import inkloop
import inkloop_controller
from inkloop.cli import main
from support.prints import quick_cuboid

CUBOID = quick_cuboid()
SHORT = {"run.layers_max": 2}


@pytest.mark.parametrize("package", [inkloop, inkloop_controller])
def test_every_public_name_is_there_and_documented(package) -> None:
    assert list(package.__all__) == sorted(package.__all__)
    assert all(getattr(package, name).__doc__ for name in package.__all__)
    assert set(package.__all__) <= set(dir(package))
    with pytest.raises(AttributeError, match=f"module '{package.__name__}' has no attribute 'nothing'"):
        _ = package.nothing


@pytest.mark.parametrize("package", ["inkloop", "inkloop_controller"])
def test_names_for_type_checkers_are_those_of_the_running_program(package: str) -> None:
    """So that neither of the two lists in `__init__` lacks a name."""
    module = import_module(package)
    tree = ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8"))
    declared = {
        alias.name: node.module
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
        if str(node.module).startswith(f"{package}.")
    }
    assert declared == {name: home for home, names in module._MODULES.items() for name in names}
    assert set(declared) == set(module.__all__)


def test_public_names_are_listed_before_and_imported_when_they_are_used() -> None:
    code = """import sys, inkloop, inkloop_controller
print([[name for name in package.__all__ if name not in dir(package)] for package in (inkloop, inkloop_controller)])
print(sorted(name for name in sys.modules if name.startswith("inkloop")))"""
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    missing, loaded = map(ast.literal_eval, shown.splitlines())
    assert missing == [[], []]
    assert loaded == ["inkloop", "inkloop_controller"]


@pytest.mark.system
def test_run_in_memory_is_the_run_of_the_command_line(tmp_path: Path) -> None:
    words = ["--set", "components.controller.alpha=0.5", "--set", "seed=7", "--set", "run.layers_max=2"]
    assert main(["run", str(CUBOID), "--no-compare", "--no-pictures", "--out", str(tmp_path / "run"), *words]) == 0
    ours = inkloop.run(str(CUBOID), {"components.controller.alpha": 0.5}, seed=7, run={"layers_max": 2})
    stored = inkloop.load(tmp_path / "run")
    assert isinstance(stored, inkloop.Result)
    volatile = ["solve_time"]
    xr.testing.assert_equal(ours.dataset.drop_vars(volatile), stored.dataset.drop_vars(volatile))
    assert ours.scenario_text == stored.scenario_text


@pytest.mark.system
def test_run_folder_of_the_api_serves_the_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = inkloop.run(CUBOID, SHORT, out=tmp_path / "run")
    stored = inkloop.load(tmp_path / "run")
    assert isinstance(stored, inkloop.Result)
    np.testing.assert_array_equal(stored.final_height, result.final_height)
    assert main(["report", str(tmp_path / "run"), "--no-pictures"]) == 0
    assert main(["resume", str(tmp_path / "run"), "--no-pictures"]) == 0
    assert "the run is finished (layers_max)" in " ".join(capsys.readouterr().out.split())
    with pytest.raises(inkloop.ResultError, match=r"that has ended .*; name another --out"):
        inkloop.run(CUBOID, SHORT, out=tmp_path / "run")


def test_loaded_scenario_prints_with_further_overrides() -> None:
    scenario = inkloop.load(CUBOID, SHORT)
    assert isinstance(scenario, inkloop.Scenario)
    assert scenario.tables.run.layers_max == 2
    assert inkloop.run(scenario).metrics()["layers"] == 2
    assert inkloop.run(scenario, run={"layers_max": 1}).metrics()["layers"] == 1


def test_result_takes_no_overrides(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="is a run folder, whose result takes no overrides; found seed"):
        inkloop.load(tmp_path, seed=7)


def test_class_next_to_the_scenario_takes_part(tmp_path: Path) -> None:
    """Python looks for it there while a scenario is read and printed, and no longer."""
    (tmp_path / "class_of_the_api.py").write_text(
        "from inkloop import Job\n\n\nclass Nothing:\n    def __init__(self, job: Job) -> None: ...\n\n"
        "    def pattern(self, height, layer):\n        return (0 * height).astype(int)\n",
        encoding="utf-8",
    )
    (tmp_path / "case.toml").write_text(CUBOID.read_text(encoding="utf-8").partition("[compare.")[0], encoding="utf-8")
    before = list(sys.path)
    text = (tmp_path / "case.toml").read_text(encoding="utf-8")
    begin = text.index("[components.controller]")
    end = text.index("[", begin + 1)
    own = '[components.controller]\nkind = "class_of_the_api:Nothing"\n\n'
    (tmp_path / "case.toml").write_text(text[:begin] + own + text[end:], encoding="utf-8")
    assert inkloop.run(tmp_path / "case.toml").metrics()["layers"] == 0
    assert sys.path == before
