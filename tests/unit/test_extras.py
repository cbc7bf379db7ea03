"""A base installation names the package and the extra that a command, an option or a file format needs."""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

import inkloop
from inkloop.cli import main
from inkloop.component import Job
from inkloop.errors import EXTRAS, InkloopError, missing, require
from inkloop.metrology.map_folder import MapFolder
from inkloop_lab import LayerEnv
from support.extras import COMMANDS, REST_IS_DONE, RUN, sentence, write_maps
from support.places import ROOT, SCENARIOS
from support.prints import THREE_AHEAD, printed
from support.source_tree import modules

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
REQUIRED_MAX = 18
OF_DEVELOPERS = {"dev", "release", "site", "test"}


def folder_of_maps(suffix: str) -> Callable[[], object]:
    """A profiler whose files have this suffix: the library is named before anything is printed."""
    job = Job(3, 3, 1e-4, np.full((3, 3), 1e-5), np.ones((3, 3), np.bool_))
    return lambda: MapFolder(job, folder=".", file_name="{layer}" + suffix)


CALLS: Mapping[str, Callable[[], object]] = {
    "gymnasium": lambda: LayerEnv(SCENARIOS / "cuboid.toml"),
    "matplotlib": lambda: inkloop.run(SCENARIOS / "cuboid.toml", out="none", pictures=["png"]),
    "PIL": folder_of_maps(".png"),
    "sdfio": folder_of_maps(".sdf"),
    "SurfaceTopography": folder_of_maps(".sur"),
    "tifffile": folder_of_maps(".tif"),
}
"""Library -> what needs it in Python."""
ELSEWHERE = {
    "pyopencl": "tests/unit/controller/planning/test_device_search.py",
    "distributed": "tests/unit/lab/sweep/test_sweep_prints.py",
    "skfem": "tests/unit/lab/reproduce/test_reproduce.py",
}
"""Library -> the test that does without it."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("extras") / "run"
    printed("cylinder", *THREE_AHEAD).save(folder)
    return folder


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A working directory with files of all formats."""
    monkeypatch.chdir(tmp_path)
    write_maps(tmp_path)


@pytest.mark.parametrize(("library", "words"), [(name, words) for name in COMMANDS for words in COMMANDS[name]])
def test_command_names_the_package_and_its_extra(
    library: str,
    words: tuple[str, ...],
    run: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    code = main([str(run) if word == RUN else word for word in words])
    shown = capsys.readouterr()
    assert sentence(library) in " ".join((shown.out + shown.err).split())
    assert (code == 0) == (words in REST_IS_DONE)
    assert not list(run.glob("*.png"))


@pytest.mark.parametrize("library", CALLS)
def test_call_names_the_package_and_its_extra(library: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises((InkloopError, ValueError), match=re.escape(sentence(library))):
        CALLS[library]()
    assert not Path("none").exists()


def test_run_without_matplotlib_prints_and_says_what_pictures_need(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    options = [
        f"--set={key}={value}" for key, value in {"part.height_um": 20, "components.controller.horizon": 1}.items()
    ]
    assert main(["run", str(SCENARIOS / "cuboid.toml"), "--no-compare", "--out", "run", *options]) == 0
    shown = capsys.readouterr()
    lines = [line for line in (shown.out + shown.err).splitlines() if "pip install" in line]
    assert lines == [f"no pictures are written: a picture {sentence('matplotlib')}"]
    assert {path.name for path in Path("run").iterdir()} == {"result.nc", "run.json", "scenario.toml", "summary.txt"}


def test_every_library_of_an_extra_is_tried() -> None:
    assert {*COMMANDS, *CALLS, *ELSEWHERE} == set(EXTRAS)
    for library, test in ELSEWHERE.items():
        assert f'"{library}", None' in (ROOT / test).read_text("utf-8")


def test_library_that_cannot_be_loaded_is_named_with_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    assert require("matplotlib", "a picture") is sys.modules["matplotlib"]
    monkeypatch.setattr("inkloop.errors.import_module", broken)
    assert missing("trimesh", "it") == "it needs the package trimesh (no libGL.so.1): pip install 'inkloop[formats]'"


def broken(module: str) -> None:
    raise ImportError("no libGL.so.1")


def packages(texts: list[str]) -> set[str]:
    """Names of packages in requirements, without extras of the project itself."""
    return {re.split(r"[\[<>=;~ ]", text)[0] for text in texts} - {"inkloop"}


def test_few_packages_are_required_and_none_of_an_extra() -> None:
    required = packages(PROJECT["dependencies"])
    assert len(required) <= REQUIRED_MAX
    assert not required & {package for package, _ in EXTRAS.values()}


def test_extras_of_users_hold_the_packages_that_messages_name() -> None:
    extras = {name: packages(texts) for name, texts in PROJECT["optional-dependencies"].items()}
    for package, extra in EXTRAS.values():
        assert package in extras[extra]
    named = {package for package, _ in EXTRAS.values()}
    assert set().union(*(found for name, found in extras.items() if name not in OF_DEVELOPERS)) == named


def test_all_holds_every_extra_of_users() -> None:
    extras = PROJECT["optional-dependencies"]

    def within(name: str) -> set[str]:
        inner = re.findall(r"inkloop\[(.*?)\]", " ".join(extras[name]))
        return {name}.union(*(within(each) for text in inner for each in text.split(",")))

    assert within("all") == set(extras) - OF_DEVELOPERS


def test_missing_packages_are_looked_for_in_one_place() -> None:
    """The others import modules of the user, of the system, or drivers of adapters."""
    catching = re.compile(r"except \(?[^:]*\b(?:ImportError|ModuleNotFoundError)\b")
    found = {name for name, path in modules().items() if catching.search(path.read_text("utf-8"))}
    assert found == {
        "inkloop.components.python_class",
        "inkloop.errors",
        "inkloop.limits",
        "inkloop_hardware.doctor.adapter_check",
    }
