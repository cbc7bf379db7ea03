"""A user with only the package can print: from a wheel, from a source distribution, from an editable install."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest

from inkloop import __version__
from inkloop.results.result import Result
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
