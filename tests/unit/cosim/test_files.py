"""Files that must outlive a power failure are synced before their names are, and the names before anything
continues.
"""

from __future__ import annotations

import codecs
import errno
import os
import pickle
import re
import signal
import stat
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from inkloop import files
from inkloop.component import Component
from inkloop.course.layer_course import LayerCourse, contract_connections
from inkloop.errors import InkloopError, ResultError, ScenarioError
from inkloop.files import (
    OWNER_FILE,
    TomlError,
    c_library,
    is_full,
    new_folder,
    opened_lock,
    read_toml_text,
    reason_of,
    remove_abandoned,
    replaced,
    sign_lock,
    temporary_folder,
    toml_tables,
    write_text,
)
from inkloop.geometry.library import _INTERFACE
from inkloop.master.master import Master
from inkloop.results.checkpoint import Checkpoints
from inkloop.results.lock import LOCK_FILE, sole_writer
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
        seen.extend(["rename"] * (target.name != OWNER_FILE))
        return replace(path, target)

    monkeypatch.setattr(os, "fsync", note_sync)
    monkeypatch.setattr(Path, "replace", note_replace)
    return seen


def test_durable_file_is_synced_renamed_and_its_folder_synced(tmp_path: Path, happenings: list[str]) -> None:
    write_text(tmp_path / "a.txt", "a", durable=True)
    assert happenings == ["file", "rename", "folder"]
    assert (tmp_path / "a.txt").read_text() == "a"
    happenings.clear()
    write_text(tmp_path / "b.txt", "b")  # not waited for
    with pytest.raises(ValueError, match="no"), replaced(tmp_path / "c.txt", durable=True):
        raise ValueError("no")
    assert happenings == ["rename"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.txt", "b.txt"]


def test_link_is_replaced_and_never_written_through(tmp_path: Path) -> None:
    """Under the name itself, under the temporary one as far as it can be known, and in the place of a lock."""
    target = tmp_path / "target"
    target.write_text("precious")
    for name in ("a.txt", ".a.txt.part"):
        (tmp_path / name).symlink_to(target)
    with replaced(tmp_path / "a.txt") as partial:
        assert partial.parent.stat().st_mode & 0o777 == 0o700
        assert partial.parents[1] == tmp_path
        partial.write_text("a")
    assert (tmp_path / "a.txt").read_text() == "a"
    assert not (tmp_path / "a.txt").is_symlink()
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / LOCK_FILE).symlink_to(target)
    with pytest.raises(ResultError, match="cannot be written there: a link lies there, which is not followed"):
        sole_writer(tmp_path / "run").__enter__()
    assert target.read_text() == "precious"


def test_folder_of_a_writer_that_was_killed_goes_with_the_first_file_of_another(place: Path) -> None:
    script = "import sys\nfrom pathlib import Path\nfrom inkloop.files import replaced\n"
    script += "with replaced(Path(sys.argv[1])) as partial:\n    partial.write_text('half')\n"
    script += "    print('half', flush=True)\n    sys.stdin.read(1)\n"

    def started(name: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-c", script, name]
        return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=place)

    writer = started("a.txt")
    assert writer.stdout
    assert writer.stdout.readline() == b"half\n"
    started("b.txt").communicate(b"x")
    assert len(list(place.iterdir())) == 2  # a living writer keeps its folder
    writer.kill()
    writer.communicate()
    started("b.txt").communicate(b"x")
    assert [path.name for path in place.iterdir()] == ["b.txt"]


@pytest.mark.parametrize("name", ["file/a.txt", "file/folder/a.txt"])
def test_file_in_the_way_of_a_folder_is_named(name: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="cannot be made: a file is in the way; name another place"):
        write_text(tmp_path / name, "a")


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
        (b'title = "a"\ntitle = "b"\n', 'line 2, `title = "b"`: this key or table is there already'),
        (b"[grid]\nnx = \n", "line 2, `nx =`: "),
        (b'title = "a\n', 'line 1, `title = "a`: '),
        (b"seed = -0,5  # one\n", "line 1, `seed = -0,5  # one`: a number has a point, no comma: -0.5"),
        (b"a = { b = 0,5, c = 1 }\n", "line 1, `a = { b = 0,5, c = 1 }`: a number has a point, no comma: 0.5"),
        (b"a = { b = 1, c = 0,5 }\n", "line 1, `a = { b = 1, c = 0,5 }`: a number has a point, no comma: 0.5"),
        (b"a = 1,2,3\n", "line 1, `a = 1,2,3`: Expected newline"),
    ],
)
def test_invalid_toml_is_explained_with_its_line(content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_bytes(content)
    with pytest.raises(TomlError) as caught:
        toml_tables(read_toml_text(tmp_path / "a.toml"))
    assert str(caught.value).startswith(f"is not TOML: {message}")


@pytest.mark.parametrize("mark", [codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE])
def test_text_in_sixteen_bits_is_told_by_its_first_two_bytes(mark: bytes, tmp_path: Path) -> None:
    encoding = "utf-16-le" if mark == codecs.BOM_UTF16_LE else "utf-16-be"
    (tmp_path / "a.toml").write_bytes(mark + "a = 1".encode(encoding))
    with pytest.raises(TomlError, match="the file is UTF-16; save it as UTF-8"):
        read_toml_text(tmp_path / "a.toml")


def test_byte_that_is_no_utf_8_is_found_in_its_line(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_bytes(b"a = 1\r\nb = '\xb5'\nc = 2\nd = 3\n")
    with pytest.raises(TomlError, match=r"line 2 is not UTF-8; byte 0xb5 is 'µ' in an older encoding"):
        read_toml_text(tmp_path / "a.toml")


def test_text_that_ends_too_early_is_explained_at_its_last_line() -> None:
    for text, line in (
        ("a = 1\nb = [1,\n2", "line 3, `2`: "),
        ('a = """x\n', 'line 1, `a = """x`: '),
        ("=", "line 1, `=`: "),
    ):
        with pytest.raises(TomlError) as caught:
            toml_tables(text)
        assert str(caught.value).startswith(f"is not TOML: {line}")


@pytest.mark.parametrize(
    ("number", "words", "full"),
    [
        (errno.ENOSPC, "the disk is full", True),
        (errno.EDQUOT, "the disk quota is used up", True),
        (errno.EFBIG, "the file becomes larger than the disk or a limit (ulimit -f) allows", True),
        (errno.ELOOP, "a link lies there, which is not followed", False),
        (errno.EACCES, "Permission denied", False),
    ],
)
def test_reason_of_an_error_is_told_in_words(number: int, words: str, full: bool) -> None:
    error = OSError(number, os.strerror(number))
    assert (reason_of(error), is_full(error)) == (words, full)
    assert reason_of(OSError("no number")) == "no number"
    assert reason_of(MemoryError()).startswith("the memory is exhausted")


def test_signature_of_a_lock_takes_the_place_of_the_one_before(tmp_path: Path) -> None:
    (tmp_path / "lock").write_text("process 1 " + 80 * "x")
    file = opened_lock(tmp_path / "lock")
    try:
        sign_lock(file)
    finally:
        os.close(file)
    assert re.fullmatch(rf"process {os.getpid()} since [\d :-]{{19}}", (tmp_path / "lock").read_text())


def test_folder_that_came_meanwhile_is_kept(tmp_path: Path) -> None:
    """An empty one, too, which the system would replace."""
    making = new_folder(tmp_path / "out")
    (making.__enter__() / "a").touch()
    (tmp_path / "out").mkdir()
    with pytest.raises(FileExistsError, match="is there already"):
        making.__exit__(None, None, None)
    assert [path.name for path in tmp_path.rglob("*")] == ["out"]


def test_error_of_another_file_keeps_its_name(tmp_path: Path) -> None:
    """That of a file under a temporary name is one of the file to be written."""
    for written, named in (("partial", "a.txt"), ("other", "other")):
        with pytest.raises(FileNotFoundError) as caught, replaced(tmp_path / "a.txt") as partial:
            (partial if written == "partial" else tmp_path / "other").read_text()
        assert caught.value.filename == str(tmp_path / named)


def test_error_of_a_scenario_passes_between_processes() -> None:
    error = ScenarioError("part.toml", ["grid.nx is 0; needs at least 1", "ink is missing"])
    copy = pickle.loads(pickle.dumps(error))
    assert type(copy) is ScenarioError
    assert str(error).splitlines() == ["part.toml: 2 errors", *(f"  - {one}" for one in error.errors)]
    assert str(ScenarioError("part.toml", error.errors[:1])).splitlines()[0] == "part.toml: 1 error"
    assert (copy.source, copy.errors, str(copy)) == (error.source, error.errors, str(error))


HOLD = """
import sys
from inkloop.files import temporary_folder
with temporary_folder("fmu") as folder:
    (folder / "model.so").write_text("binary")
    print(folder, flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    return tmp_path


def test_folder_is_empty_and_goes_at_the_end_however_it_ends(place: Path) -> None:
    with temporary_folder("fmu") as folder:
        assert list(folder.iterdir()) == []
        (folder / OWNER_FILE).write_text("a member of an archive may have any name")
    assert list(place.iterdir()) == []
    with pytest.raises(KeyError), temporary_folder("fmu"):
        raise KeyError
    assert list(place.iterdir()) == []


def test_folder_of_a_killed_process_is_removed_and_that_of_a_living_one_stays(place: Path) -> None:
    killed, living = (
        subprocess.Popen([sys.executable, "-c", HOLD], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        for _ in range(2)
    )
    folders = [Path(process.stdout.readline().strip()) for process in (killed, living)]
    assert all((folder / "model.so").exists() for folder in folders)
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    with temporary_folder("run") as own:
        assert not folders[0].exists()
        assert folders[1].exists()
        assert own.exists()
        assert remove_abandoned(place) == []
    living.communicate("")
    assert list(place.iterdir()) == []


def test_what_is_not_surely_abandoned_stays(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    others = [place / name for name in ("inkloop-fmu-1-x", f"inkloop-fmu-{os.getpid()}-x", "inkloop-tests", "a-b-1-c")]
    for folder in others:
        folder.mkdir()
    for folder in others[1:]:
        (folder / OWNER_FILE).touch()
    assert remove_abandoned(place) == []  # without a lock file, of this process, of another name
    elsewhere = place / "elsewhere"
    elsewhere.touch()
    (others[0] / OWNER_FILE).symlink_to(elsewhere)
    assert remove_abandoned(place) == []  # a link is no lock
    (others[0] / OWNER_FILE).unlink()
    (others[0] / OWNER_FILE).touch()
    monkeypatch.setattr(files, "take_lock", lambda file: (_ for _ in ()).throw(OSError("no locks here")))
    assert remove_abandoned(place) == []
    monkeypatch.undo()
    assert remove_abandoned(place) == [others[0]]


def loaded(interface: int, **entry_points: Any) -> Any:
    return c_library("inkloop.geometry", "inkloop_columns", "INKLOOP_COLUMNS_LIB", interface, entry_points)


def test_library_of_other_sources_than_its_modules_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Older and newer ones; also one that lacks a function, and a file that is none."""
    for interface in (_INTERFACE - 1, _INTERFACE + 1):
        with pytest.raises(InkloopError, match="was built from other sources than this Python code; run make"):
            loaded(interface)
    assert loaded(_INTERFACE).inkloop_columns_interface() == _INTERFACE
    with pytest.raises(InkloopError, match=r"is not inkloop_columns of this inkloop \(.*nothing.*\); install inkloop"):
        loaded(_INTERFACE, nothing=(None, ()))
    with pytest.raises(InkloopError, match=r"inkloop_none\.\w+ is not installed \(looked for .*inkloop.geometry"):
        c_library("inkloop.geometry", "inkloop_none", "INKLOOP_COLUMNS_LIB", 1, {})
    for name, words in (
        ("none.so", "no such file; unset it"),
        (".", "no such file; unset it"),
        ("a.so", "is not inkl"),
    ):
        (tmp_path / "a.so").write_text("no library")
        monkeypatch.setenv("INKLOOP_COLUMNS_LIB", str(tmp_path / name))
        with pytest.raises(InkloopError, match=words):
            loaded(_INTERFACE)
