"""A user with only the package can print: from a wheel, from a source distribution, from an editable install."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import tarfile
import tomllib
from pathlib import Path

import pytest

from inkloop import __version__
from inkloop.errors import EXTRAS
from inkloop.results.result import Result
from support.extras import COMMANDS, REST_IS_DONE, RUN, sentence, write_maps
from support.places import ROOT

PIP = (sys._base_executable, "-m", "pip", "--disable-pip-version-check", "--quiet")  # type: ignore[attr-defined]
pytestmark = pytest.mark.long


def call(*command: str | Path, cwd: Path) -> str:
    """The output of a command; fails with its errors."""
    run = subprocess.run([*command], cwd=cwd, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout


@pytest.fixture(scope="module")
def sdist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A source distribution of the working tree."""
    folder = tmp_path_factory.mktemp("sdist")
    code = "import sys; from scikit_build_core.build import build_sdist; print(build_sdist(sys.argv[1]))"
    name = call(sys.executable, "-c", code, folder, cwd=ROOT).splitlines()[-1]
    return folder / name


@pytest.fixture(scope="module")
def archive(sdist: Path) -> Path:
    """The files of the source distribution, in a folder that git does not know."""
    with tarfile.open(sdist) as packed:
        packed.extractall(sdist.parent, filter="data")
    return sdist.parent / sdist.name.removesuffix(".tar.gz")


def make_without_git(target: str, archive: Path, bin_folder: Path) -> subprocess.CompletedProcess[str]:
    """`make TARGET` in the archive, with the tools of this environment, no git, and nothing on standard input."""
    path = archive.parent / "path"
    path.mkdir(exist_ok=True)
    for name in ("make", "sh", "find", "python3"):
        program = shutil.which(name)
        assert program is not None, name
        (path / name).unlink(missing_ok=True)
        (path / name).symlink_to(program)
    return subprocess.run(
        ["make", target, f"BIN={bin_folder}", "--old-file=.venv/developer"],
        cwd=archive,
        env={**os.environ, "PATH": str(path)},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )


def target(way: str, sdist: Path, folder: Path) -> list[str | Path]:
    """The distribution that pip installs; built below `folder`."""
    if way == "editable":
        with tarfile.open(sdist) as archive:
            archive.extractall(folder, filter="data")
        return ["--editable", folder / sdist.name.removesuffix(".tar.gz")]
    source = sdist if way == "wheel of sdist" else ROOT
    build_folder = f"--config-settings=build-dir={folder / 'build'}"  # leaves the one of the working tree alone
    call(*PIP, "wheel", "--no-deps", "--wheel-dir", folder / "dist", build_folder, source, cwd=folder)
    (wheel,) = (folder / "dist").glob("inkloop-*.whl")
    assert "py3-none" in wheel.name
    return [wheel]


@pytest.mark.parametrize("way", ["wheel", "wheel of sdist", "editable"])
def test_clean_environment_prints_from_another_folder(way: str, sdist: Path, tmp_path: Path) -> None:
    call(sys._base_executable, "-m", "venv", "--without-pip", tmp_path / "venv", cwd=tmp_path)  # type: ignore[attr-defined]
    bin_folder = tmp_path / "venv" / "bin"
    call(*PIP, "--python", bin_folder / "python", "install", *target(way, sdist, tmp_path), cwd=tmp_path)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "mine.toml").write_text((ROOT / "scenarios" / "cuboid.toml").read_text("utf-8"), encoding="utf-8")
    assert call(bin_folder / "inkloop", "--version", cwd=elsewhere).split() == ["inkloop", __version__]
    code = "import inkloop_fmus, inkloop.fmu_writer.export as e; print(e.find_fmu('LayerDeposition', 'fmi2').resolve())"
    fmu = Path(call(bin_folder / "python", "-c", code, cwd=elsewhere).strip())
    assert tmp_path in fmu.parents
    assert "made by    inkloop" in call(bin_folder / "inkloop", "info", fmu, cwd=elsewhere)
    code = "from inkloop_hardware.protocol.codec import Codec; print(Codec().protocol_version)"
    assert call(bin_folder / "python", "-c", code, cwd=elsewhere).strip() == "1"
    call(bin_folder / "inkloop", "run", "mine.toml", "--out", "run", cwd=elsewhere)
    assert Result.load(elsewhere / "run").metrics()["layers"] >= 3


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clean environment with a wheel and the required packages only."""
    folder = tmp_path_factory.mktemp("base")
    call(sys._base_executable, "-m", "venv", "--without-pip", folder / "venv", cwd=folder)  # type: ignore[attr-defined]
    install = (*PIP, "--python", folder / "venv/bin/python", "install", "--no-compile")
    required = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["dependencies"]
    done = subprocess.run([*install, *required], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        pytest.skip(f"the required packages cannot be installed here: {done.stderr.strip().splitlines()[-1]}")
    call(*install, "--no-deps", *target("wheel", Path(), folder), cwd=folder)
    write_maps(folder)
    return folder


def test_base_installation_prints_validates_and_exports(base: Path) -> None:
    inkloop = base / "venv/bin/inkloop"
    shown = call(inkloop, "run", "cylinder", "--out", RUN, cwd=base)
    assert shown.count("pip install") == 1
    assert f"a picture {sentence('matplotlib')}" in shown
    assert {path.name for path in (base / RUN).iterdir()} >= {"result.nc", "summary.txt", "run.json"}
    assert Result.load(base / RUN).metrics()["mae"] < 1e-6
    assert "no errors" in call(inkloop, "validate", "cylinder", cwd=base)
    assert "wrote" in call(inkloop, "export", "fmu", "LayerDeposition", "--out", "plant.fmu", cwd=base)
    assert "made by    inkloop" in call(inkloop, "info", "plant.fmu", cwd=base)


def test_base_installation_prints_on_an_emulated_bench(base: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    short = (f"--set=bench.channel=socket://127.0.0.1:{port}", "--set=part.height_um=10")
    emulate: list[str | Path] = [base / "venv/bin/inkloop", "bench", "emulate", "bench", *short]
    unbuffered = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(emulate, cwd=base, env=unbuffered, stdout=subprocess.PIPE, text=True) as emulator:
        try:
            assert emulator.stdout is not None
            assert any("Ctrl-C ends it" in line for line in emulator.stdout)
            call(base / "venv/bin/inkloop", "run", "bench", *short, "--out", "bench-run", cwd=base)
        finally:
            emulator.terminate()
    assert Result.load(base / "bench-run").stop_reason == "done"


def test_base_installation_names_the_extra_of_each_feature(base: Path) -> None:
    sentences = {sentence(library) for library in EXTRAS}
    if not (base / RUN).exists():
        call(base / "venv/bin/inkloop", "run", "cylinder", "--no-compare", "--out", RUN, cwd=base)
    for words in sorted({words for commands in COMMANDS.values() for words in commands}):
        done = subprocess.run(
            [base / "venv/bin/inkloop", *words], cwd=base, capture_output=True, text=True, check=False
        )
        shown = " ".join((done.stdout + done.stderr).split())
        assert "Traceback" not in shown, words
        assert sum(each in shown for each in sentences) == 1, (words, shown)
        assert (done.returncode == 0) == (words in REST_IS_DONE), (words, shown)


def test_source_archive_is_linted_without_git(archive: Path) -> None:
    bin_folder = Path(sys.executable).parent
    run = make_without_git("lint", archive, bin_folder)
    assert run.returncode == 0, run.stdout + run.stderr
    source = archive / "fmus/layer_deposition/layer_map.c"
    source.write_text(source.read_text("utf-8") + "int  badly_formatted ;\n", encoding="utf-8")
    run = make_without_git("lint", archive, bin_folder)
    assert run.returncode != 0
    assert "layer_map.c" in run.stderr


def test_source_archive_has_all_that_make_and_the_tests_read(archive: Path) -> None:
    listed = {path.relative_to(archive).parts[0] for path in archive.rglob("*") if path.is_file()}
    assert listed >= {
        "Makefile",
        "constraints.txt",
        "tests",
        "tools",
        "scenarios",
        "docs",
        ".ci",
        ".github",
        ".clang-format",
    }
