"""Binaries for other platforms: the right folders and formats, only the standard's functions, the same numbers."""

from __future__ import annotations

import importlib.util
import logging
import re
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Literal
from urllib.parse import quote

import fmpy
import numpy as np
import pytest

from inkloop.cli import main
from inkloop.errors import FmuError
from inkloop.exchange import layer_job
from inkloop.exchange.layer_job import bake
from inkloop.fmu import describe
from inkloop.fmu_writer.archive import unpack
from inkloop.fmu_writer.export import COMPILER, LAYER_JOB, export_fmu, with_platforms
from inkloop.fmu_writer.targets import TARGETS, platforms_in
from support.fmus import amplifier
from support.fmus.fmu_driver import MODELS
from support.fmus.foreign_run import (
    WINE,
    answers,
    compiled,
    numbers,
    script_of,
    wine_in,
)
from support.fmus.library_symbols import declared, exports, newest_glibc, parsed
from support.fmus.twenty_layers import HAS_QEMU, HAS_WINE, TwentyLayers
from support.masters.loops import TEXT, scenario_in

FOLDERS = {
    "2": {"linux64", "win64", "darwin64"},
    "3": {"x86_64-linux", "aarch64-linux", "x86_64-windows", "aarch64-windows", "x86_64-darwin", "aarch64-darwin"},
}
"""As FMI 2.0.5 (2.2.1.1) and FMI 3.0.2 (2.5.1.4) name them."""
FORMATS = {
    **{"linux64": ["x86_64-linux"], "win64": ["x86_64-windows"], "darwin64": ["x86_64-darwin", "aarch64-darwin"]},
    **{name: [name] for name in FOLDERS["3"]},
}
HAS_COMPILER = pytest.mark.skipif(
    importlib.util.find_spec(COMPILER) is None, reason="needs ziglang (make tools, or pip install ziglang)"
)
VALUES = {
    "ProfileSensor": {"noise_std": 1e-6, "drift_rate": 1e-7, "scan_duration": 0.0},
    "LayerController": {"layers_scanned": 0.0},
    "LayerJob": {"layer_period": 1.0, "layer_duration": 0.0, "scan_duration": 0.0},
    "VolumeAreaDeposition": {"layer_period": 1.0},
}
DEPOSITION = {"layer_period": 1.0, "variation": 0.3}
OTHER_LIBM = dict.fromkeys(("LayerJob", "ProfileSensor", "YoungLaplaceDeposition"), 1e-12)
"""Relative difference allowed where a tan or a cube root of another C library goes into the heights, or a logarithm and
a cosine into the noise of the sensor. On some processors they have the same bits."""
OLDEST_GLIBC = (2, 17)
SYSTEM_LIBRARIES = {
    "linux": r"lib(c|m)\.so\.6|ld-linux-\S+",
    "windows": r"KERNEL32\.dll|api-ms-win-crt-\S+\.dll",  # the universal C runtime, part of Windows 10
    "darwin": r"/usr/lib/libSystem\.B\.dylib",
}

pytestmark = [pytest.mark.compiled, pytest.mark.system]


def exported(model: str, fmi: Literal["2", "3"], folder: Path, *platforms: str, side: int = 9) -> Path:
    path = folder / f"{model}.fmu"
    if model == LAYER_JOB:
        layer_job.write(bake(scenario_in(folder)), fmi, path, platforms=platforms or None)
        return path
    return export_fmu(model, fmi=fmi, nx=side, ny=side, fixed=True, platforms=platforms or None, out=path)


@pytest.mark.long
@HAS_COMPILER
@pytest.mark.parametrize("fmi", FOLDERS)
@pytest.mark.parametrize("model", ["LayerDeposition", "LayerController"])
def test_every_platform_has_its_binary_of_the_standards_functions(
    model: str, fmi: Literal["2", "3"], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Folders and formats, no function but those of the standard, no library that a system does not have."""
    with caplog.at_level(logging.WARNING, "inkloop.fmu_writer.export"):
        members = unpack(exported(model, fmi, tmp_path))
        bare = {name: content for name, content in members.items() if not name.startswith("binaries/")}
        members = with_platforms(bare, fmi, ["all"])  # all by zig, also that of this machine
    assert not caplog.messages  # -Wall -Wextra -Wpedantic
    binaries = {name.split("/")[1]: content for name, content in members.items() if name.startswith("binaries/")}
    assert set(binaries) == FOLDERS[fmi]
    assert {folder: platforms_in(content) for folder, content in binaries.items()} == {
        folder: FORMATS[folder] for folder in FOLDERS[fmi]
    }
    for folder, content in binaries.items():
        system = FORMATS[folder][0].partition("-")[2]
        images = parsed(content)
        assert len(images) == len(FORMATS[folder])
        for image in images:
            assert exports(image) == declared(fmi), folder
            needed = [str(getattr(library, "name", library)) for library in image.libraries]
            others = [name for name in needed if not re.fullmatch(SYSTEM_LIBRARIES[system], name)]
            assert [name for name in others if not name.endswith(f"{model}.dylib")] == []
            if system == "linux":
                assert newest_glibc(image) <= OLDEST_GLIBC


@pytest.fixture(scope="module")
def twenty(tmp_path_factory: pytest.TempPathFactory) -> TwentyLayers:
    return TwentyLayers(tmp_path_factory.mktemp("twenty"))


@pytest.mark.long
@HAS_COMPILER
@pytest.mark.parametrize(
    "name",
    [
        "x86_64-linux",
        pytest.param("aarch64-linux", marks=HAS_QEMU),
        pytest.param("x86_64-windows", marks=HAS_WINE),
    ],
)
def test_twenty_layers_have_the_bits_of_the_native_compiler(
    name: str, twenty: TwentyLayers, wine: dict[str, str]
) -> None:
    assert twenty.by_zig(name, wine) == twenty.by_gcc(wine)


@HAS_COMPILER
@HAS_WINE
@pytest.mark.long
@pytest.mark.parametrize("fmi", ["2", "3"])
@pytest.mark.parametrize("model", [*MODELS, LAYER_JOB])
def test_windows_binary_gives_the_numbers_of_the_native_one(
    model: str, fmi: Literal["2", "3"], tmp_path: Path, wine: dict[str, str]
) -> None:
    path = exported(model, fmi, tmp_path, "x86_64-linux", "x86_64-windows")
    folder = Path(fmpy.extract(str(path), str(tmp_path / "un packed")))
    description = fmpy.read_model_description(str(folder))
    script = script_of(description, VALUES.get(model, DEPOSITION), 1.0, 4)
    native = folder / "binaries" / (fmpy.platform if fmi == "2" else fmpy.platform_tuple)
    library = next(native.iterdir())
    token = description.guid if fmi == "2" else description.instantiationToken
    resources = f"{folder}/resources/"
    here, there = resources, f"Z:{resources}"  # FMI 2 has a URI there, FMI 3 a path
    if fmi == "2":
        here, there = f"file://{quote(resources)}", f"file:///Z:{quote(resources)}"
    expected = answers([compiled(None, tmp_path / "calls"), fmi, library, token, here], script, wine)
    program = compiled(TARGETS["x86_64-windows"], tmp_path / "calls.exe")
    dll = folder / "binaries" / ("win64" if fmi == "2" else "x86_64-windows") / f"{model}.dll"
    found = answers([WINE or "", program, fmi, dll, token, there], script, wine)
    assert len(set(expected.split())) > 3
    if model in OTHER_LIBM:
        np.testing.assert_allclose(numbers(found), numbers(expected), rtol=OTHER_LIBM[model])
    else:
        assert found == expected


@pytest.fixture(scope="module")
def wine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    if WINE is None:
        yield {}
        return
    with wine_in(tmp_path_factory.mktemp("wine")) as environment:
        yield environment


@pytest.mark.long
@HAS_COMPILER
def test_system_for_a_tool_on_windows_has_the_binary_in_our_fmus(tmp_path: Path) -> None:
    amplifier.build(tmp_path, 2)
    text = TEXT + '[components.other]\nkind = "Fmu"\nfile = "amplifier2.fmu"\n'
    (tmp_path / "block.toml").write_text(text, encoding="utf-8")
    words = ["-o", str(tmp_path / "it.ssp"), "--platforms", "x86_64-windows,x86_64-linux"]
    assert main(["export", "ssp", str(tmp_path / "block.toml"), *words]) == 0
    with zipfile.ZipFile(tmp_path / "it.ssp") as opened:
        opened.extractall(tmp_path / "it")
    platforms = {file.stem: set(describe(file).platforms) for file in (tmp_path / "it/resources").glob("*.fmu")}
    ours = {name: {fmpy.platform, "win64"} for name in ("controller", "printer", "profiler")}
    assert platforms == {**ours, "other": {fmpy.platform}}


@pytest.mark.long
@HAS_COMPILER
def test_refused_sources_are_reported_with_the_compilers_message(tmp_path: Path) -> None:
    members = {**unpack(exported("ProfileSensor", "3", tmp_path)), "sources/values.c": b"#error no such thing here\n"}
    with pytest.raises(FmuError, match=r"(?s)refuses the sources of ProfileSensor for .*:\n.*no such thing here"):
        with_platforms(members, "3", ["aarch64-linux"])
