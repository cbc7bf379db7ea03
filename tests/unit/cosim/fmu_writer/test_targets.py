"""Platforms of FMUs: names, folders, formats, and which binaries an export holds."""

from __future__ import annotations

import struct
import sys
from pathlib import Path

import fmpy
import pytest

from inkloop.cli import main
from inkloop.errors import FmuError
from inkloop.fmu import describe
from inkloop.fmu_writer import archive, export
from inkloop.fmu_writer.archive import unpack
from inkloop.fmu_writer.export import find_fmu, with_platforms
from inkloop.fmu_writer.targets import TARGETS, platforms_in, targets_of, universal
from support.places import ROOT

NATIVE = fmpy.platform_tuple


def mach_o(processor: int, size: int) -> bytes:
    return struct.pack("<Iii", 0xFEEDFACF, processor, 3) + bytes(range(256)) * (size // 256)


def test_folders_are_those_of_the_standards() -> None:
    assert set(targets_of(["all"], "3")) == set(TARGETS)
    assert {folder: [t.name for t in found] for folder, found in targets_of(["all"], "2").items()} == {
        "linux64": ["x86_64-linux"],
        "win64": ["x86_64-windows"],
        "darwin64": ["x86_64-darwin", "aarch64-darwin"],
    }
    assert set(targets_of(["aarch64-darwin"], "2")) == {"darwin64"}  # for both processors


def test_all_faults_of_a_list_are_named_at_once() -> None:
    with pytest.raises(FmuError, match=r"'x86_64-linus', did you mean x86_64-linux.*FMI 2 has no folder for aarch64-w"):
        targets_of(["x86_64-linus", "aarch64-windows"], "2")
    with pytest.raises(FmuError, match="no platform is named"):
        targets_of([], "3")


def test_universal_file_holds_each_binary_at_a_page(tmp_path: Path) -> None:
    parts = [mach_o(0x01000007, 512), mach_o(0x0100000C, 20_000)]
    made = universal(parts)
    assert platforms_in(made) == ["x86_64-darwin", "aarch64-darwin"]
    for k, part in enumerate(parts):
        processor, _, offset, size, alignment = struct.unpack_from(">iiIII", made, 8 + 20 * k)
        assert made[offset : offset + size] == part
        assert offset % (1 << alignment) == 0
        assert processor == struct.unpack_from("<i", part, 4)[0]
    assert universal(parts[:1]) == parts[0]
    with pytest.raises(FmuError, match="expected a 64-bit Mach-O file"):
        universal([parts[0], b"MZ" + bytes(100)])


@pytest.mark.parametrize("form", ["fmi2", "fmi3"])
def test_binaries_of_the_built_set_are_for_the_platform_of_their_folder(form: str) -> None:
    members = unpack(find_fmu("LayerDeposition", form))
    found = {name.split("/")[1]: content for name, content in members.items() if name.startswith("binaries/")}
    folders = targets_of(["all"], form[3])
    assert NATIVE in {name for content in found.values() for name in platforms_in(content)}
    for folder, content in found.items():
        if folder in folders:
            assert platforms_in(content) == [target.name for target in folders[folder]]
    assert platforms_in(b"no binary") == []


@pytest.mark.parametrize(("processor", "names"), [(0x8664, ["x86_64-windows"]), (0xAA64, ["aarch64-windows"]), (1, [])])
def test_binary_of_windows_names_its_processor_behind_the_header_of_dos(processor: int, names: list[str]) -> None:
    dos = b"MZ" + bytes(0x3A) + struct.pack("<I", 0x50) + bytes(16)
    assert platforms_in(dos + b"PE\0\0" + struct.pack("<HH", processor, 7)) == names


@pytest.mark.parametrize("form", ["fmi2", "fmi3"])
def test_each_of_several_binaries_is_packed_into_the_folder_of_its_platform(form: str, tmp_path: Path) -> None:
    elf = b"\x7fELF" + bytes(14)
    contents = {
        "a.so": elf + struct.pack("<H", 62) + bytes(20),
        "b.so": elf + struct.pack("<H", 183) + bytes(20),
        "c.dylib": mach_o(0x0100000C, 512),
        "d.dylib": mach_o(0x01000007, 512),
    }
    for name, content in contents.items():
        (tmp_path / name).write_bytes(content)
    model = ROOT / "fmus/layer_deposition"
    (tmp_path / "it.c").write_text("", encoding="utf-8")
    words = ["--form", form, "--platform", "unused", "--version", "1", "--out", str(tmp_path / "it.fmu")]
    words += ["--definition", str(model / "variables.toml"), "--readme", str(model / "readme.md")]
    words += [
        "--icon",
        str(model / "icon.png"),
        "--diagram",
        str(model / "diagram.png"),
        "--license",
        str(ROOT / "LICENSE"),
        "--sources",
        str(tmp_path / "it.c"),
    ]
    assert archive.main(["pack", *words, "--binary", *(str(tmp_path / name) for name in contents)]) == 0
    members = unpack(tmp_path / "it.fmu")
    found = {name: platforms_in(content) for name, content in members.items() if name.startswith("binaries/")}
    both = ["x86_64-darwin", "aarch64-darwin"]
    expected = {
        "fmi2": {"linux64/LayerDeposition.so": ["x86_64-linux"], "darwin64/LayerDeposition.dylib": both},
        "fmi3": {
            **{f"{name}/LayerDeposition.so": [name] for name in ("x86_64-linux", "aarch64-linux")},
            **{f"{name}/LayerDeposition.dylib": [name] for name in both},
        },
    }
    assert found == {f"binaries/{name}": platforms for name, platforms in expected[form].items()}


def test_export_holds_the_named_platforms_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Binaries that are there need no compiler."""
    monkeypatch.setitem(sys.modules, export.COMPILER, None)
    members = unpack(find_fmu("ProfileSensor", "fmi3"))
    both = {**members, "binaries/aarch64-darwin/ProfileSensor.dylib": mach_o(0x0100000C, 512)}
    for names in ([NATIVE], ["aarch64-darwin"], [NATIVE, "aarch64-darwin"]):
        found = with_platforms(both, "3", names)
        assert {name.split("/")[1] for name in found if name.startswith("binaries/")} == set(names)
        assert found["sources/values.c"] == members["sources/values.c"]
    path = tmp_path / "it.fmu"
    assert main(["export", "fmu", "ProfileSensor", "--platforms", NATIVE, "--out", str(path)]) == 0
    assert describe(path).platforms == (NATIVE,)
