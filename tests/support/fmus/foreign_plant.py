"""The files of docs/tutorial/your-own-plant.md, and its FMUs built by PythonFMU, which shares nothing with ours."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

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
