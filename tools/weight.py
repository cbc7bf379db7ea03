"""Print the size of the project: `make weight`. Counted are the files that git lists.

- product: lines of .py .c .h .mo .js .dbc below models, fmus, controller, hardware, cosim, lab and benchmarks, blanks
  included; tests: lines of .py .c .h below tests.
- pages: words of .md below docs; README: words of README.md.
- modules: .py below cosim, controller, hardware and lab.
- packages: requirements of `inkloop` without extras; commands: entries of `inkloop --help`.
- riddles: comments of .c and .h, and docstrings of the modules, that begin with "What " or "How ".
"""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from collections.abc import Iterable
from pathlib import Path

from inkloop.units import KILO

ROOT = Path(__file__).parents[1]
PACKAGES = ("cosim", "controller", "hardware", "lab")
PRODUCT = (*PACKAGES, "models", "fmus", "benchmarks")
RIDDLE = re.compile(r'(?:/\*+|//|""")\s*(?:What|How) ')


def files(folders: Iterable[str], suffixes: str) -> list[Path]:
    """Those that git lists below these folders, deleted ones left out."""
    patterns = [f"{folder}/**/*.{suffix}" for folder in folders for suffix in suffixes.split()]
    patterns = [f":(glob){pattern}" for pattern in patterns]
    listed = subprocess.run(["git", "ls-files", *patterns], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return [path for path in map(ROOT.joinpath, listed.splitlines()) if path.is_file()]


def text(paths: Iterable[Path]) -> str:
    """All that these files say."""
    return "".join(path.read_text(encoding="utf-8") for path in paths)


def lines(paths: Iterable[Path]) -> int:
    """Lines of all these files."""
    return sum(path.read_bytes().count(b"\n") for path in paths)


def thousands(count: int) -> str:
    """With one decimal."""
    return f"{count / KILO:.1f}"


def commands() -> int:
    """Entries of the command line's help."""
    program = [sys.executable, "-c", "from inkloop.cli import main; main(['--help'])"]
    shown = subprocess.run(program, check=True, capture_output=True, text=True).stdout
    return len(re.findall(r"^    [a-z][\w-]*(?:\s{2}|$)", shown.partition("COMMAND\n")[2], re.MULTILINE))


def rows() -> dict[str, str]:
    """Name of each figure -> the figure."""
    modules = files(PACKAGES, "py")
    sources = files((*PRODUCT, "tests"), "c h")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return {
        "product, k lines": thousands(lines(files(PRODUCT, "py c h mo js dbc"))),
        "tests, k lines": thousands(lines(files(["tests"], "py c h"))),
        "words of pages, k": thousands(len(text(files(["docs"], "md")).split())),
        "Python modules": f"{len(modules)}",
        "required packages": f"{len(project['dependencies'])}",
        "commands at the top": f"{commands()}",
        "words of README": f"{len((ROOT / 'README.md').read_text(encoding='utf-8').split())}",
        "riddles": f"{len(RIDDLE.findall(text([*modules, *sources])))}",
    }


if __name__ == "__main__":
    for name, figure in rows().items():
        print(f"{name:<22}{figure:>8}")
