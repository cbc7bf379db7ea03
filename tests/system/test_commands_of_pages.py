"""The commands of the pages do what the pages say: each is run in its page's order, or named here with a reason."""

from __future__ import annotations

import importlib.util
import re
import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from inkloop.cli import main
from inkloop.metrology.height_map import HeightMap
from inkloop.metrology.map_writing import write
from support.page_commands import COMMANDS_BY_PAGE
from support.places import ROOT

pytestmark = [pytest.mark.system, pytest.mark.long, pytest.mark.usefixtures("without_pictures")]

LEFT_OUT = {
    r"bench ": "devices, or an emulator that runs next to it: tests of benches",
    r"run (scenarios/|my-)bench\.toml": "the same",
    r"report runs/bench": "the same",
    r"watch ": "serves until Ctrl-C: tests of the page in a browser",
    r"score( |$)": "prints for minutes: tests of the score board",
    r"sweep (?!.*--check)": "prints for minutes: tests of studies",
    r"run theirs\.ssp": "a file of the reader's",
    r"identify ": "experiments for a minute: tests of identification",
    r"resume ": "a run that was stopped: tests of resumed runs",
    r"(info Deposit\.fmu|(validate|run) plant\.toml)": "an FMU that another program builds: tests of the tutorial",
}
"""Command lines that are not run, by a pattern at their begin, and who runs them."""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs that readers of the pages have: of the cylinder, and of some layers with a grey head."""
    folder = tmp_path_factory.mktemp("kept") / "runs"
    quiet = ("--quiet", "--no-pictures", "--no-compare")
    assert main(["run", "cylinder", "--out", str(folder / "cylinder"), *quiet]) == 0
    layers = ("--set", "run.layers_max=3")
    assert main(["run", "grey-head", "--out", str(folder / "grey-head"), *layers, *quiet]) == 0
    return folder


@pytest.fixture
def desk(runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with what the pages take for granted: runs, scenarios, a part, maps of a profiler."""
    shutil.copytree(runs, tmp_path / "runs")
    (tmp_path / "scenarios").symlink_to(ROOT / "scenarios")
    shutil.copy(ROOT / "scenarios/parts/bracket.stl", tmp_path)
    waves = np.add.outer(np.sin(np.arange(500) / 9.0), np.cos(np.arange(400) / 7.0))
    np.save(tmp_path / "scan.npy", waves)
    write(tmp_path / "scan.sdf", HeightMap(waves * 1e-6, dx=5e-6, dy=5e-6), "sdf")
    np.save(tmp_path / "mine.npy", np.ones(waves.shape, dtype=bool))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def is_left_out(line: str) -> bool:
    return any(re.match(pattern, line) for pattern in LEFT_OUT)


def kept_lines(page: str) -> Iterator[list[str]]:
    """The words of the commands of a page that are run."""
    for line in COMMANDS_BY_PAGE[page]:
        if not is_left_out(line):
            yield shlex.split(line, comments=True)


@pytest.mark.parametrize("page", sorted(page for page in COMMANDS_BY_PAGE if list(kept_lines(page))))
def test_commands_of_a_page_end_well(page: str, desk: Path, capsys: pytest.CaptureFixture[str]) -> None:
    if page == "tutorial/first-print.md":
        shutil.copy(desk / "scenarios/cuboid.toml", desk / "mine.toml")
    for words in kept_lines(page):
        if "--platforms" in words and importlib.util.find_spec("ziglang") is None:
            continue
        code = main(words)
        output = capsys.readouterr()
        assert code == 0, f"inkloop {shlex.join(words)}: {output.err}"


def test_every_reason_belongs_to_a_command() -> None:
    lines = [line for commands in COMMANDS_BY_PAGE.values() for line in commands]
    assert not [pattern for pattern in LEFT_OUT if not any(re.match(pattern, line) for line in lines)]
