"""Binaries for Windows: no warning, only the standard's functions, no foreign DLL, under Wine the same numbers."""

from __future__ import annotations

import logging
import re
import shutil
import subprocess
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal
from urllib.parse import quote

import fmpy
import numpy as np
import pytest

from inkloop.cli import main
from inkloop.errors import FmuError
from inkloop.exchange.job import archive
from inkloop.exchange.job.baking import bake
from inkloop.fmu import describe
from inkloop.fmu_writer import windows
from inkloop.fmu_writer.archive import unpack
from inkloop.fmu_writer.export import LAYER_JOB, export_fmu
from inkloop.fmu_writer.windows import COMPILER, with_windows_binary
from support.fmus import amplifier
from support.fmus.fmu_driver import MODELS
from support.fmus.windows_run import HEADERS, WINE, answers, compiled, numbers, script_of, wine_in
from support.masters.six_by_six import TEXT, scenario_in

FOLDERS = {"2": "win64", "3": "x86_64-windows"}
HAS_COMPILER = pytest.mark.skipif(shutil.which(COMPILER) is None, reason=f"needs {COMPILER} (make tools)")
HAS_WINE = pytest.mark.skipif(WINE is None, reason="needs wine64 (make tools)")
VALUES = {
    "ProfileSensor": {"noise_std": 1e-6, "drift_rate": 1e-7, "scan_duration": 0.0},
    "LayerController": {"layers_scanned": 0.0},
    "LayerJob": {"layer_period": 1.0, "layer_duration": 0.0, "scan_duration": 0.0},
    "VolumeAreaDeposition": {"layer_period": 1.0},
}
DEPOSITION = {"layer_period": 1.0, "variation": 0.3}
OTHER_LIBM = {"YoungLaplaceDeposition": 1e-12}
"""Relative difference allowed where a tan or a cube root of another C library goes into the heights."""


def cases(*quick: str) -> list[Any]:
    """All models in both versions of FMI; those that are not quick, which take a compiler seconds, are long."""
    return [
        pytest.param(model, fmi, id=f"{model} FMI {fmi}", marks=[] if model in quick else [pytest.mark.long])
        for model in (*MODELS, LAYER_JOB)
        for fmi in FOLDERS
    ]


def exported(model: str, fmi: Literal["2", "3"], folder: Path) -> Path:
    if model == LAYER_JOB:
        archive.write(bake(scenario_in(folder)), fmi, folder / "LayerJob.fmu", windows=True)
        return folder / "LayerJob.fmu"
    return export_fmu(model, fmi=fmi, nx=9, ny=9, fixed=False, windows=True, out=folder / f"{model}.fmu")


def declared(fmi: str) -> set[str]:
    """The functions of the standard for co-simulation, and in FMI 3 for all kinds."""
    header = (HEADERS / f"fmi{fmi}Functions.h").read_text()
    if fmi == "2":
        *_, co_simulation = header.split("Functions for FMI2 for Co-Simulation")
        header = header.split("Functions for FMI2 for Model Exchange")[1] + co_simulation
    return set(re.findall(rf"FMI{fmi}_Export fmi\w+TYPE\s+(fmi\w+);", header))


@HAS_COMPILER
@pytest.mark.parametrize(("model", "fmi"), cases("LayerDeposition"))
def test_binary_exports_the_standard_and_needs_what_every_windows_has(
    model: str, fmi: Literal["2", "3"], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING, "inkloop.fmu_writer.windows"):
        path = exported(model, fmi, tmp_path)
    assert not caplog.messages  # -Wall -Wextra -Wpedantic
    with zipfile.ZipFile(path) as archive:
        archive.extract(f"binaries/{FOLDERS[fmi]}/{model}.dll", tmp_path)
    binary = tmp_path / f"binaries/{FOLDERS[fmi]}/{model}.dll"
    objdump = COMPILER.removesuffix("gcc") + "objdump"
    listing = subprocess.run([objdump, "-p", binary], check=True, capture_output=True, text=True).stdout
    assert "file format pei-x86-64" in listing
    assert set(re.findall(r"DLL Name: (\S+)", listing)) <= {"KERNEL32.dll", "msvcrt.dll"}
    (table,) = re.findall(r"\[Ordinal/Name Pointer\] Table\n((?:\s*\[.*\n)+)", listing)
    exports = set(re.findall(r"\]\s+(\S+)$", table, re.MULTILINE))
    assert len(exports) > 30
    assert exports == declared(fmi)


@HAS_COMPILER
@HAS_WINE
@pytest.mark.long
@pytest.mark.parametrize(("model", "fmi"), cases())
def test_binary_gives_the_numbers_of_the_native_one(
    model: str, fmi: Literal["2", "3"], tmp_path: Path, wine: dict[str, str]
) -> None:
    folder = Path(fmpy.extract(str(exported(model, fmi, tmp_path)), str(tmp_path / "un packed")))
    description = fmpy.read_model_description(str(folder))
    script = script_of(description, VALUES.get(model, DEPOSITION), 1.0, 4)
    native = folder / "binaries" / (fmpy.platform if fmi == "2" else fmpy.platform_tuple)
    library = next(native.iterdir())
    token = description.guid if fmi == "2" else description.instantiationToken
    resources = f"{folder}/resources/"
    here, there = resources, f"Z:{resources}"  # FMI 2 has a URI there, FMI 3 a path
    if fmi == "2":
        here, there = f"file://{quote(resources)}", f"file:///Z:{quote(resources)}"
    program = compiled("gcc", int(fmi), tmp_path / "calls")
    expected = answers([program, library, token, here], script, wine)
    program = compiled(COMPILER, int(fmi), tmp_path / "calls.exe")
    dll = folder / "binaries" / FOLDERS[fmi] / f"{model}.dll"
    found = answers([WINE or "", program, dll, token, there], script, wine)
    assert len(set(expected.split())) > 3
    if model in OTHER_LIBM:
        np.testing.assert_allclose(numbers(found), numbers(expected), rtol=OTHER_LIBM[model])
    else:
        assert found == expected


@pytest.fixture(scope="module")
def wine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    with wine_in(tmp_path_factory.mktemp("wine")) as environment:
        yield environment


@HAS_COMPILER
def test_command_adds_the_binary_next_to_the_native_one(tmp_path: Path) -> None:
    path = tmp_path / "it.fmu"
    assert main(["export", "ProfileSensor", "--fmi", "2", "--windows", "--out", str(path)]) == 0
    assert set(describe(path).platforms) == {fmpy.platform, "win64"}
    rows = fmpy.simulate_fmu(str(path), stop_time=1.0, output=["layers_scanned"])
    assert np.isfinite(rows["layers_scanned"]).all()


@HAS_COMPILER
def test_system_for_a_tool_on_windows_has_the_binary_in_our_fmus(tmp_path: Path) -> None:
    amplifier.build(tmp_path, 2)
    text = TEXT + '[components.other]\nkind = "Fmu"\nfile = "amplifier2.fmu"\n'
    (tmp_path / "block.toml").write_text(text, encoding="utf-8")
    assert main(["export-ssp", str(tmp_path / "block.toml"), "-o", str(tmp_path / "it.ssp"), "--windows"]) == 0
    with zipfile.ZipFile(tmp_path / "it.ssp") as archive:
        archive.extractall(tmp_path / "it")
    platforms = {file.stem: set(describe(file).platforms) for file in (tmp_path / "it/resources").glob("*.fmu")}
    ours = {name: {fmpy.platform, "win64"} for name in ("controller", "printer", "profiler")}
    assert platforms == {**ours, "other": {fmpy.platform}}


def test_missing_compiler_is_named_with_its_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(windows, "COMPILER", "x86_64-w64-mingw32-gcc-missing")
    with pytest.raises(FmuError, match=r"needs the cross compiler .*-missing.* gcc-mingw-w64-x86-64"):
        exported("ProfileSensor", "3", tmp_path)
    assert not list(tmp_path.iterdir())


@HAS_COMPILER
def test_refused_sources_are_reported_with_the_compilers_message(tmp_path: Path) -> None:
    path = export_fmu("ProfileSensor", fmi="3", nx=3, ny=2, fixed=False, out=tmp_path / "it.fmu")
    members = {**unpack(path), "sources/values.c": b"#error no such thing here\n"}
    with pytest.raises(FmuError, match=r"(?s)refuses the sources of ProfileSensor:\n.*no such thing here"):
        with_windows_binary(members, "3")
