"""Processor time of what a developer waits for, for architecture.md: start-up, `make`, `make check`, `make test`.

Nothing is measured unless it is named: `python -m tools.figures house_times/check` measures `make check` alone.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from benchmarks.startup import over_nothing
from tools.figures.pages import DOCS, ROOT, Texts, read_json, table, write_json

PAGE = DOCS / "explanation" / "architecture.md"
RECORD = PAGE.with_name("house-times.json")
BEFORE = {
    "startup": {
        "`inkloop --version`, over `python -c pass`": "4.2 s",
        "`inkloop validate`, over `python -c pass`": "4.3 s",
    },
    "make": {"`make`, after the downloads": "105 s", "C files compiled for it": "427"},
    "check": {"`make check`": "-"},
    "test": {"`make test`": "18 min"},
}
"""Part -> what is measured, and what version 0.1.0 took, measured by hand; it had no `make check`."""


def _startup() -> list[str]:
    return [f"{over_nothing(words):.2f} s" for words in ("--version", "validate cylinder.toml")]


def _make() -> list[str]:
    """In a clone of the last commit, after the downloads: pip gets its packages from a folder and asks no index."""
    python = sys._base_executable  # type: ignore[attr-defined]
    pip = [python, "-m", "pip", "--python", sys.executable, "download", "--quiet"]
    with tempfile.TemporaryDirectory() as folder:
        clone, packages = Path(folder) / "inkloop", Path(folder) / "packages"
        _processor_s(["git", "clone", "--quiet", ROOT, clone], ROOT)
        project = tomllib.loads((clone / "pyproject.toml").read_text("utf-8"))
        needed = [*project["build-system"]["requires"], *project["project"]["dependencies"]]
        _processor_s([*pip, "--dest", packages, "--constraint", clone / "constraints.txt", *needed], clone)
        taken = _processor_s(["make", f"PYTHON={python}"], clone, PIP_NO_INDEX="1", PIP_FIND_LINKS=str(packages))
        (build,) = (clone / "build").glob("py3-*")
        ninja: list[str | Path] = [sys.executable, "-m", "ninja", "-C", build, "-t", "commands"]
        commands = subprocess.run(ninja, check=True, capture_output=True, text=True).stdout.splitlines()
    return [f"{taken:.0f} s", f"{sum(' -c ' in command for command in commands)}"]


def _check() -> list[str]:
    return [f"{_processor_s(['make', 'check'], ROOT) / 60.0:.1f} min"]


def _test() -> list[str]:
    return [f"{_processor_s(['make', 'test'], ROOT) / 60.0:.1f} min"]


MEASURED: Mapping[str, Callable[[], list[str]]] = {
    "startup": _startup,
    "make": _make,
    "check": _check,
    "test": _test,
}
"""Part -> its figures now."""


def _processor_s(command: Sequence[str | Path], folder: Path, **environment: str) -> float:
    """User and system time of a command with all that it starts. Raises CalledProcessError."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    outside = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}  # no make around it
    subprocess.run(command, cwd=folder, check=True, env=outside | environment, stdout=sys.stderr)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def run(*parts: str) -> None:
    """Measure these parts, or all; keep the other figures."""
    record = read_json(RECORD) if RECORD.exists() else {}
    for part in parts or MEASURED:
        record[part] = MEASURED[part]()
        write_json(RECORD, {name: record[name] for name in MEASURED if name in record})


def texts() -> Texts:
    """The table."""
    record = read_json(RECORD)
    rows = [
        (what, before, now)
        for part, figures in BEFORE.items()
        for (what, before), now in zip(figures.items(), record.get(part, ["-"] * len(figures)), strict=True)
    ]
    return {PAGE: {"house times": table(("processor time", "0.1.0", "now"), rows)}}
