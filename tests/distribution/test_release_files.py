"""The files of a release: every binary for its platform, only the standard's functions, the same bytes twice."""

from __future__ import annotations

import hashlib
import importlib.util
import io
import json
import os
import re
import shutil
import struct
import subprocess
import sys
import zipfile
from email.message import Message
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from inkloop import __version__
from inkloop.fmu import describe
from inkloop.fmu_writer.targets import TARGETS, platforms_in
from inkloop.results.result import Result
from support.fmus.library_symbols import declared, exports, newest_glibc, parsed
from support.places import ROOT

HERE = "x86_64-linux"
NAMED = "INKLOOP_RELEASE"
"""Variable of the environment: the folder of a release that was built before, for all platforms or some."""
HAS_TOOLS = pytest.mark.skipif(
    any(importlib.util.find_spec(name) is None for name in ("ziglang", "cyclonedx")),
    reason="needs the extra `release` (pip install 'inkloop[release]')",
)
ELF, PE = b"\x7fELF" + bytes(14) + struct.pack("<H", 62), b"MZ" + bytes(58) + struct.pack("<I", 64) + b"PE\0\0\x64\x86"
MACH_O = b"\xcf\xfa\xed\xfe" + struct.pack("<I", 0x01000007)


def zipped(members: dict[str, bytes]) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return packed.getvalue()


def whole_wheel() -> dict[str, bytes]:
    """A wheel for Linux with FMUs for Linux and Windows."""
    fmi2 = zipped({"binaries/linux64/A.so": ELF, "binaries/win64/A.dll": PE})
    fmi3 = zipped({"binaries/x86_64-linux/A.so": ELF, "binaries/x86_64-windows/A.dll": PE})
    return {
        "inkloop/geometry/libinkloop_columns.so": ELF,
        "inkloop_lab/models/libinkloop_models.so": ELF,
        "inkloop_controller/libinkloop_core.so": ELF,
        "inkloop_hardware/inkloop_bench_nodes": ELF,
        "inkloop_fmus/fmi2/A.fmu": fmi2,
        "inkloop_fmus/fmi3/A.fmu": fmi3,
        "inkloop_fmus/fmi3-fixed/A.template": fmi3,
    }


def test_wheel_is_refused_for_a_part_that_is_missing_or_of_another_platform(tmp_path: Path) -> None:
    from tools.release.contents import check_wheel

    targets = [TARGETS[HERE], TARGETS["x86_64-windows"]]
    path = tmp_path / "it.whl"
    path.write_bytes(zipped(whole_wheel()))
    check_wheel(path, TARGETS[HERE], targets)
    faulty = whole_wheel()
    del faulty["inkloop_hardware/inkloop_bench_nodes"]
    faulty["inkloop_controller/libinkloop_core.so"] = MACH_O
    faulty["inkloop_fmus/fmi2/A.fmu"] = zipped({"binaries/linux64/A.so": ELF})
    faulty["inkloop_fmus/fmi3/A.fmu"] = zipped(
        {"binaries/x86_64-linux/A.so": ELF, "binaries/x86_64-windows/A.dll": ELF}
    )
    path.write_bytes(zipped(faulty))
    with pytest.raises(Exception, match=r"it\.whl is not whole") as raised:
        check_wheel(path, TARGETS[HERE], targets)
    said = str(raised.value)
    assert "inkloop_bench_nodes is missing" in said
    assert "libinkloop_core.so is for ['x86_64-darwin']; expected x86_64-linux" in said
    assert "fmi2/A.fmu: has binaries for x86_64-linux; expected x86_64-linux, x86_64-windows" in said
    assert "fmi3/A.fmu: has binaries for x86_64-linux, x86_64-linux; expected" in said
    twice = {"binaries/x86_64-linux/A.so": ELF, "binaries/x86_64-linux/B.so": ELF, "binaries/x86_64-windows/A.dll": PE}
    path.write_bytes(zipped(whole_wheel() | {"inkloop_fmus/fmi3/A.fmu": zipped(twice)}))
    with pytest.raises(Exception, match="has binaries for x86_64-linux, x86_64-linux, x86_64-windows; expected"):
        check_wheel(path, TARGETS[HERE], targets)


def test_folder_with_files_of_others_is_refused_and_left_as_it_is(tmp_path: Path) -> None:
    from tools.release.contents import SUMS, earlier_files

    assert earlier_files(tmp_path / "new") == []
    (tmp_path / "a.whl").write_bytes(b"wheel")
    (tmp_path / SUMS).write_text("00  a.whl\n")
    assert [path.name for path in earlier_files(tmp_path)] == [SUMS, "a.whl"]
    (tmp_path / "thesis.tex").write_text("mine")
    (tmp_path / "runs").mkdir()
    with pytest.raises(Exception, match=r"holds runs, thesis\.tex, which no release wrote; name an empty folder"):
        earlier_files(tmp_path)
    with pytest.raises(Exception, match="is a file; name a folder"):
        earlier_files(tmp_path / "a.whl")
    for path in (tmp_path / "a.whl", tmp_path / "thesis.tex"):
        path.unlink()
    (tmp_path / "a.whl").mkdir()
    with pytest.raises(Exception, match=r"holds a\.whl, runs, which no release wrote"):
        earlier_files(tmp_path)


def built(out: Path) -> dict[str, str]:
    """The files of a release for this platform, built in a folder and with an object cache of its own: name -> sum."""
    environment = {**os.environ, "SOURCE_DATE_EPOCH": "1700000000"}
    command = [sys.executable, "-m", "tools.release", "--out", str(out), HERE]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in out.iterdir()}


@pytest.fixture(scope="module")
def release(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a release: what NAMED says, else one for this platform, built here."""
    if named := os.environ.get(NAMED):
        return Path(named).resolve()
    out = tmp_path_factory.mktemp("release")
    built(out)
    return out


@HAS_TOOLS
@pytest.mark.long
@pytest.mark.compiled
def test_release_has_the_same_bytes_when_repeated(release: Path, tmp_path: Path) -> None:
    if NAMED in os.environ:
        pytest.skip(f"compares two releases that it builds, not the one that {NAMED} names")
    again = built(tmp_path / "again")
    assert len(again) == 4
    assert again == {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in release.iterdir()}


@HAS_TOOLS
@pytest.mark.long
@pytest.mark.compiled
def test_sums_and_bill_of_materials_are_of_the_files(release: Path) -> None:
    program = shutil.which("sha256sum")
    assert program is not None
    checked = subprocess.run(
        [program, "--check", "SHA256SUMS"], cwd=release, capture_output=True, text=True, check=True
    )
    assert checked.stdout.count(": OK") == len(list(release.iterdir())) - 1 >= 3
    bill = json.loads((release / f"inkloop-{__version__}.cdx.json").read_text("utf-8"))
    files = {each["url"]: each["hashes"][0]["content"] for each in bill["metadata"]["component"]["externalReferences"]}
    wheel = wheel_name(HERE)
    assert set(files) >= {wheel, f"inkloop-{__version__}.tar.gz"}
    assert files[wheel] == hashlib.sha256((release / wheel).read_bytes()).hexdigest()
    scopes = {each["name"]: each["scope"] for each in bill["components"]}
    assert (scopes["casadi"], scopes["numpy"], scopes["ziglang"]) == ("required", "required", "excluded")
    assert "pytest" not in scopes
    needed = {each["ref"]: each.get("dependsOn", []) for each in bill["dependencies"]}
    assert any(
        name.startswith("pyserial==") for ref in needed if ref.startswith("python-can==") for name in needed[ref]
    )


@HAS_TOOLS
@pytest.mark.long
@pytest.mark.compiled
def test_binaries_offer_their_own_functions_and_need_an_old_system_only(release: Path) -> None:
    path = release / wheel_name(HERE)
    with zipfile.ZipFile(path) as wheel:
        own = {name: content for name in wheel.namelist() if platforms_in(content := wheel.read(name))}
        fmus = {name: wheel.read(name) for name in wheel.namelist() if name.endswith(".fmu")}
    assert (len(own), len(fmus)) == (4, 18)
    for name, content in own.items():
        (image,) = parsed(content)
        assert newest_glibc(image) <= (2, 17), name
        assert all(re.match("inkloop_|columns_", each) for each in exports(image)) or "bench_nodes" in name, name
    for name, content in fmus.items():
        with zipfile.ZipFile(io.BytesIO(content)) as fmu:
            binaries = {each: fmu.read(each) for each in fmu.namelist() if each.startswith("binaries/")}
        assert any("linux" in place for place in binaries), name
        for place, binary in binaries.items():
            for image in parsed(binary):
                assert exports(image) == declared("2" if "/fmi2/" in name else "3"), (name, place)
                assert not place.endswith(".so") or newest_glibc(image) <= (2, 17), (name, place)


def wheel_name(platform: str) -> str:
    return f"inkloop-{__version__}-py3-none-{TARGETS[platform].wheel}.whl"


def install(clean_root: Path, what: Path | str) -> subprocess.CompletedProcess[str]:
    """A package into the environment of a clean root, as the page on platforms tells users to."""
    python = sys._base_executable  # type: ignore[attr-defined]
    pip = [python, "-m", "pip", "--python", str(clean_root / "venv/bin/python"), "install"]
    options = ["--quiet", "--disable-pip-version-check", "--no-compile", "--only-binary=:all:"]
    options += ["--constraint", str(ROOT / "constraints.txt")]
    return subprocess.run([*pip, *options, str(what)], capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def clean_root(release: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an environment that holds the wheel for this platform and what it requires, nothing else."""
    folder = tmp_path_factory.mktemp("clean")
    base = sys._base_executable  # type: ignore[attr-defined]
    subprocess.run([base, "-m", "venv", "--without-pip", folder / "venv"], check=True)
    done = install(folder, release / wheel_name(HERE))
    if done.returncode != 0 and re.search("Connection|Temporary failure|No matching distribution", done.stderr):
        pytest.skip("needs the packages that inkloop requires, from the network or the cache of pip")
    assert done.returncode == 0, done.stderr
    return folder


def called(clean_root: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """A program of the environment, where there is no other: no compiler, no make."""
    programs = clean_root / "venv/bin"
    environment = {"PATH": str(programs), "HOME": str(clean_root), "LANG": "C.UTF-8"}
    command = [str(programs / words[0]), *words[1:]]
    return subprocess.run(command, cwd=clean_root, env=environment, capture_output=True, text=True, check=False)


@HAS_TOOLS
@pytest.mark.long
@pytest.mark.compiled
def test_fmus_of_the_wheel_print_a_scenario_with_the_bits_of_the_native_build(clean_root: Path, tmp_path: Path) -> None:
    words = ("run", "cylinder", "--set", "components.controller.kind=LayerController", "--out")
    done = called(clean_root, "inkloop", *words, "run")
    assert done.returncode == 0, done.stderr
    here = [str(Path(sys.executable).parent / "inkloop"), *words, str(tmp_path / "run")]
    subprocess.run(here, check=True, capture_output=True)
    ours, native = Result.load(clean_root / "run").dataset, Result.load(tmp_path / "run").dataset
    assert native.height.size > 1000
    np.testing.assert_array_equal(ours.height, native.height)
    np.testing.assert_array_equal(ours.pattern, native.pattern)


@HAS_TOOLS
@pytest.mark.long
@pytest.mark.compiled
def test_wheel_exports_for_another_platform_or_names_the_extra(clean_root: Path) -> None:
    """A whole release has binaries for all platforms in each wheel; one for this platform only needs the extra."""
    (folder,) = (clean_root / "venv/lib").glob("python3.*/site-packages/inkloop_fmus/fmi3")
    platforms = describe(folder / "LayerDeposition.fmu").platforms
    export = ("inkloop", "export", "fmu", "LayerDeposition", "--platforms", "aarch64-linux", "--out", "other.fmu")
    done = called(clean_root, *export)
    if "aarch64-linux" not in platforms:
        assert done.returncode != 0
        assert "pip install 'inkloop[cross]'" in done.stderr
        assert "Traceback" not in done.stderr
        assert install(clean_root, "ziglang").returncode == 0
        done = called(clean_root, *export)
    assert done.returncode == 0, done.stderr
    assert describe(clean_root / "other.fmu").platforms == ("aarch64-linux",)


def test_bill_of_materials_has_each_package_once_with_its_licence_and_needs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("cyclonedx", reason="needs the extra `release`")
    from tools.release import sbom

    def package(name: str, *lines: str) -> SimpleNamespace:
        metadata = Message()
        for line in (f"Name: {name}", "Version: 1.5", *lines):
            metadata.add_header(*line.split(": ", 1))
        return SimpleNamespace(metadata=metadata)

    classified = ("Classifier: License :: OSI Approved :: MIT License", "Classifier: Topic :: Printing")
    required = {
        "a": package("A", "License-Expression: MIT", "License: other"),
        "both": package("both", "License: Apache-2.0", *classified),
    }
    builders = {"both": required["both"], "zig": package("zig", "License: " + "long " * 20, *classified)}
    asked: list[tuple[list[str], bool]] = []

    def closure(
        wanted: list[str], *, transitive: bool = True
    ) -> tuple[dict[str, SimpleNamespace], dict[str, set[str]]]:
        asked.append((list(wanted), transitive))
        return (required, {"": {"a"}, "a": {"both"}, "both": set()}) if transitive else (builders, {})

    monkeypatch.setattr(sbom, "closure", closure)
    project = '[project]\nname = "it"\nversion = "3.1"\nlicense = "BSD-3-Clause"\ndependencies = ["a>=1"]\n'
    (tmp_path / "pyproject.toml").write_text(f'{project}[build-system]\nrequires = ["both"]\n')
    (tmp_path / "made").mkdir()
    (tmp_path / "made" / "it.whl").write_bytes(b"wheel")
    path = sbom.write_sbom(tmp_path, tmp_path / "made", 1700000000)
    assert asked == [(["a>=1"], True), (["both", "ziglang"], False)]
    assert path.name == "it-3.1.cdx.json"
    bill = json.loads(path.read_text("utf-8"))
    assert bill["metadata"]["timestamp"] == "2023-11-14T22:13:20+00:00"
    (file,) = bill["metadata"]["component"]["externalReferences"]
    assert (file["url"], file["hashes"][0]["content"]) == ("it.whl", hashlib.sha256(b"wheel").hexdigest())
    assert {each["name"]: (each["version"], each["scope"]) for each in bill["components"]} == {
        "a": ("1.5", "required"),
        "both": ("1.5", "required"),
        "zig": ("1.5", "excluded"),
    }
    licences = {each["name"]: next(iter(each["licenses"][0].values())) for each in bill["components"]}
    assert {name: each["id"] if "id" in each else each["name"] for name, each in licences.items()} == {
        "a": "MIT",
        "both": "Apache-2.0",
        "zig": "MIT License",
    }
    needed = {each["ref"]: each.get("dependsOn", []) for each in bill["dependencies"]}
    assert (needed["it"], needed["a==1.5"], needed["both==1.5"]) == (["a==1.5"], ["both==1.5"], [])


def test_parts_of_a_wheel_are_named_as_its_system_names_them() -> None:
    from tools.release.contents import compiled_parts

    assert compiled_parts(TARGETS["x86_64-windows"]) == [
        "inkloop/geometry/inkloop_columns.dll",
        "inkloop_lab/models/inkloop_models.dll",
        "inkloop_controller/inkloop_core.dll",
    ]
    assert len(compiled_parts(TARGETS[HERE])) == 4


def test_wheel_without_fmus_and_files_of_no_platform_are_named(tmp_path: Path) -> None:
    from tools.release.contents import wheel_faults

    faulty = whole_wheel()
    del faulty["inkloop_fmus/fmi3-fixed/A.template"]
    faulty["inkloop_fmus/fmi3/A.fmu"] = zipped({"binaries/x86_64-linux/A.so": ELF, "binaries/readme": b"text"})
    faulty["inkloop_hardware/inkloop_bench_nodes"] = b"#!/bin/sh"
    with zipfile.ZipFile(io.BytesIO(zipped(faulty))) as archive:
        faults = list(wheel_faults(archive, TARGETS[HERE], [TARGETS[HERE]]))
    assert faults[:2] == [
        "inkloop_hardware/inkloop_bench_nodes is for no known platform; expected x86_64-linux",
        "inkloop_fmus/fmi3-fixed has no FMU",
    ]
    assert "inkloop_fmus/fmi3/A.fmu: binaries/readme is for no known platform" in faults
    whole = whole_wheel() | {"inkloop_fmus/fmi3-fixed/A.template": zipped({"binaries/x86_64-linux/A.so": ELF})}
    with zipfile.ZipFile(io.BytesIO(zipped(whole))) as archive:
        faults = list(wheel_faults(archive, TARGETS[HERE], [TARGETS[HERE], TARGETS["x86_64-windows"]]))
    assert [fault.partition(":")[0] for fault in faults] == ["inkloop_fmus/fmi3-fixed/A.template"]


def test_message_about_files_of_others_names_five(tmp_path: Path) -> None:
    from tools.release.contents import earlier_files

    for number in range(5):
        (tmp_path / f"{number}").write_text("")
    with pytest.raises(Exception, match="holds 0, 1, 2, 3, 4, which no release wrote"):
        earlier_files(tmp_path)
    (tmp_path / "5").write_text("")
    with pytest.raises(Exception, match=r"holds 0, 1, 2, 3, 4, \.\.\., which no release wrote"):
        earlier_files(tmp_path)


def test_release_replaces_an_earlier_one_with_sums_of_all_its_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Built by doubles: wheels say for which targets they were made."""
    pytest.importorskip("ziglang", reason="needs the extra `release`")
    pytest.importorskip("cyclonedx", reason="needs the extra `release`")
    from tools.release import __main__ as program
    from tools.release.contents import SUMS

    def made(name: str, content: bytes, folder: Path) -> Path:
        (folder / name).write_bytes(content)
        return folder / name

    compiled: list[str] = []
    monkeypatch.setattr(program, "source_epoch", lambda root: 17)
    monkeypatch.setattr(program, "build_sdist", lambda root, folder, epoch: made("it.tar.gz", b"%d" % epoch, folder))
    monkeypatch.setattr(program, "unpacked", lambda sdist, folder: folder)
    monkeypatch.setattr(program, "compile_binaries", lambda target, source, builds: compiled.append(target.name))
    monkeypatch.setattr(
        program, "build_wheel", lambda target, source, builds, folder, epoch: made(f"{target.name}.whl", b"w", folder)
    )
    monkeypatch.setattr(program, "check_wheel", lambda wheel, target, targets: compiled.append(f"{wheel.name} checked"))
    monkeypatch.setattr(program, "write_sbom", lambda root, folder, epoch: made("it.cdx.json", b"{}", folder))
    out = tmp_path / "release"
    out.mkdir()
    (out / "old.whl").write_bytes(b"old")
    (out / SUMS).write_text("00  old.whl\n")
    found = program.release([HERE, "aarch64-linux"], out)
    targets = [HERE, "aarch64-linux"]
    assert sorted(compiled[:2]) == sorted(targets)
    assert sorted(compiled[2:]) == sorted(f"{name}.whl checked" for name in targets)
    files = sorted(["it.tar.gz", "it.cdx.json", *(f"{name}.whl" for name in targets)])
    assert sorted(path.name for path in out.iterdir()) == sorted([SUMS, *files]) == sorted(path.name for path in found)
    assert (out / SUMS).read_text().splitlines() == [
        f"{hashlib.sha256((out / name).read_bytes()).hexdigest()}  {name}" for name in files
    ]
