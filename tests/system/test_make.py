"""The Python that `make` installs with."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path

import pytest

from support.places import ROOT

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")


def python_of_make(folder: Path, *words: str, path: str = "", **environment: str) -> Path:
    """The Python that runs pip, for a Makefile in the folder; `path` comes first on the PATH."""
    outside = {name: value for name, value in os.environ.items() if not name.startswith(("MAKE", "MFLAGS", "PYTHON"))}
    run = subprocess.run(
        [
            "make",
            "--silent",
            f"--file={ROOT / 'Makefile'}",
            "--eval=python: ; @echo $(firstword $(PIP))",
            "python",
            *words,
        ],
        cwd=folder,
        env={**outside, "PATH": os.pathsep.join([path, os.environ["PATH"]]), **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return Path(run.stdout.strip())


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a .venv as `make` makes it."""
    folder = tmp_path_factory.mktemp("clone")
    venv.create(folder / ".venv", symlinks=os.name != "nt")
    return folder


@pytest.mark.parametrize("chosen", [{}, {"PYTHON": "python3"}])
def test_activated_environment_without_pip_is_not_what_make_installs_with(folder: Path, chosen: dict[str, str]) -> None:
    activated = folder / ".venv" / "bin"
    python = python_of_make(folder, path=str(activated), VIRTUAL_ENV=str(activated.parent), **chosen)
    assert python.is_absolute()
    assert folder not in python.parents
    same = "import sys; print(sys.prefix == sys.base_prefix, *sys.version_info[:2])"
    found = subprocess.run([python, "-c", same], capture_output=True, text=True, check=True).stdout.split()
    assert found == ["True", *map(str, sys.version_info[:2])]


def test_other_activated_environment_is_what_make_installs_with(folder: Path, tmp_path: Path) -> None:
    activated = folder / ".venv" / "bin"
    assert python_of_make(tmp_path, path=str(activated)) == Path("python3")
    python = activated / "python"
    assert python_of_make(tmp_path, f"PYTHON={python}") == python
