"""Files that must outlive a power failure are synced before their names are, and the names before anything
continues.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

import numpy as np
import pytest

from inkloop.component import Component
from inkloop.course.layer_course import LayerCourse
from inkloop.course.wiring import contract_connections
from inkloop.files import TomlError, read_toml_text, replaced, toml_tables, write_text
from inkloop.master.master import Master
from inkloop.results.checkpoint import Checkpoints
from inkloop.results.recorder import Recorder
from inkloop.results.result import Result
from inkloop.testing import job
from support.benches.device_toys import DevicePrinter, DeviceProfiler
from support.toys import ToyController, ToyPrinter, ToyProfiler


@pytest.fixture
def happenings(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """ "file", "folder" and "rename", in the order in which they were synced or done."""
    seen: list[str] = []
    sync, replace = os.fsync, Path.replace

    def note_sync(descriptor: int) -> None:
        seen.append("folder" if stat.S_ISDIR(os.fstat(descriptor).st_mode) else "file")
        sync(descriptor)

    def note_replace(path: Path, target: Path) -> Path:
        seen.append("rename")
        return replace(path, target)

    monkeypatch.setattr(os, "fsync", note_sync)
    monkeypatch.setattr(Path, "replace", note_replace)
    return seen


def test_durable_file_is_synced_renamed_and_its_folder_synced(tmp_path: Path, happenings: list[str]) -> None:
    write_text(tmp_path / "a.txt", "a", durable=True)
    assert happenings == ["file", "rename", "folder"]
    assert (tmp_path / "a.txt").read_text() == "a"


def test_other_files_are_not_waited_for(tmp_path: Path, happenings: list[str]) -> None:
    write_text(tmp_path / "a.txt", "a")
    assert happenings == ["rename"]


@pytest.mark.parametrize("name", ["file/a.txt", "file/folder/a.txt"])
def test_file_in_the_way_of_a_folder_is_named(name: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="cannot be made: a file is in the way; name another place"):
        write_text(tmp_path / name, "a")


def test_file_that_failed_is_neither_synced_nor_there(tmp_path: Path, happenings: list[str]) -> None:
    with pytest.raises(ValueError, match="no"), replaced(tmp_path / "a.txt", durable=True):
        raise ValueError("no")
    assert happenings == []
    assert list(tmp_path.iterdir()) == []


def test_run_folder_is_on_the_disk_before_the_run_begins(tmp_path: Path, happenings: list[str]) -> None:
    Result.begin(tmp_path / "run", "", {})
    assert happenings == ["folder", *["file", "rename", "folder"] * 2]


@pytest.mark.parametrize("devices", [True, False])
def test_checkpoints_of_devices_outlive_a_power_failure(devices: bool, tmp_path: Path, happenings: list[str]) -> None:
    """Those of a simulation need not: it can be printed again."""
    part = job()
    printer = DevicePrinter(part) if devices else ToyPrinter(part)
    profiler = DeviceProfiler(part, printer) if isinstance(printer, DevicePrinter) else ToyProfiler(part)
    parts: dict[str, Component] = {"controller": ToyController(part), "printer": printer, "profiler": profiler}
    recorder = Recorder(part, parts)
    checkpoints = Checkpoints(tmp_path / "run", parts, recorder)
    (tmp_path / "run").mkdir()
    Master(
        parts,
        contract_connections(parts),
        step_ns=10**9,
        observers=[recorder, checkpoints],
        course=LayerCourse(parts, layers_max=2),
    ).run()
    assert checkpoints.layer == 2
    written = happenings.count("rename")
    assert written >= 6
    assert happenings == ["folder", *(["file", "rename", "folder"] if devices else ["rename"]) * written]
    assert np.load(tmp_path / "run" / "layers" / "state.npz")["point"][1] == 2


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b'title = "a"\nname = "h\xf6he"\n', "line 2 is not UTF-8; byte 0xf6 is 'ö' in an older encoding of Windows"),
        ('title = "a"\n'.encode("utf-16"), "the file is UTF-16; save it as UTF-8"),
        ("[part]\nheight_µm = 3.0\n".encode(), "line 2, `height_µm = 3.0`: a key without quotes has no 'µ'; write um"),
        (b"[grid]\nnx = 3\nnx = 5\n", "line 3, `nx = 5`: this key or table is there already"),
        (b'title = "a"\ntitle = "b"\n', 'line 2, `title = "b"`: this key or table is there already'),
        (b"[grid]\nnx = \n", "line 2, `nx =`: "),
        (b'title = "a\n', 'line 1, `title = "a`: '),
    ],
)
def test_invalid_toml_is_explained_with_its_line(content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_bytes(content)
    with pytest.raises(TomlError) as caught:
        toml_tables(read_toml_text(tmp_path / "a.toml"))
    assert str(caught.value).startswith(f"is not TOML: {message}")


def test_byte_order_mark_is_skipped(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_bytes(b"\xef\xbb\xbfnx = 3\r\n")
    assert toml_tables(read_toml_text(tmp_path / "a.toml")) == {"nx": 3}
