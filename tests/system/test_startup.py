"""Commands that need no picture, table of results or optimizer do not load the libraries for them."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from inkloop.fmu_writer.export import find_fmu
from support.places import SCENARIOS
from support.prints import quick_cuboid

HEAVY = ("matplotlib", "scipy", "xarray", "pandas", "casadi", "plotly", "starlette", "uvicorn", "anyio")
CODE = """
import json, sys
from inkloop.cli import main
try:
    code = main(sys.argv[2:])
except SystemExit as end:
    code = end.code
open(sys.argv[1], "w").write(json.dumps([code, sorted({name.partition(".")[0] for name in sys.modules})]))
"""


def loaded(folder: Path, *words: str) -> tuple[int, set[str]]:
    """Exit code of a command, and the packages that it has loaded."""
    report = folder / "modules.json"
    subprocess.run([sys.executable, "-c", CODE, str(report), *words], cwd=folder, check=True, capture_output=True)
    code, packages = json.loads(report.read_text())
    return int(code), set(packages)


COMMANDS = {
    "--version": (),
    "--help": (),
    "run": ("--help",),
    "validate": (str(SCENARIOS / "cylinder.toml"),),
    "new": ("mine",),
    "schema": (),
    "info": (str(find_fmu("LayerDeposition")),),
    "export": ("LayerDeposition",),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_light_commands_load_no_heavy_library(command: str, tmp_path: Path) -> None:
    code, packages = loaded(tmp_path, command, *COMMANDS[command])
    assert code == 0
    assert not packages & {*HEAVY}


@pytest.mark.parametrize("word", ["--version", "--help"])
def test_version_and_help_load_no_library_at_all(word: str, tmp_path: Path) -> None:
    _, packages = loaded(tmp_path, word)
    assert not packages & {"numpy", "pydantic", "tomlkit", "fmpy", "rich", "shtab"}


def test_heavy_libraries_are_seen_where_a_command_loads_them(tmp_path: Path) -> None:
    """So that the tests above can fail."""
    code, packages = loaded(tmp_path, "score", "absent:Controller")
    assert code == 1
    assert packages >= {"matplotlib", "xarray"}


def test_run_without_pictures_draws_nothing(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    code, packages = loaded(tmp_path, "run", str(quick_cuboid()), "--out", str(folder), "--no-compare", "--no-pictures")
    assert code == 0
    assert "xarray" in packages
    assert "matplotlib" not in packages
    assert (folder / "summary.txt").is_file()
    assert not list(folder.glob("*.png"))


def test_layer_mpc_needs_casadi_only_for_its_engines() -> None:
    code = (
        "import sys; from inkloop.testing import job; from inkloop_controller import LayerMpc; LayerMpc(job()); "
        "print('casadi' in sys.modules); LayerMpc(job(), relaxation='ipopt'); print('casadi' in sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["False", "True"]
