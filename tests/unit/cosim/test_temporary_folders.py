"""A temporary folder goes with its process: at the end of its block, or, after a kill, when the next one is made."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from inkloop import files
from inkloop.files import OWNER_FILE, remove_abandoned, temporary_folder

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
    (others[0] / OWNER_FILE).touch()
    monkeypatch.setattr(files, "take_lock", lambda file: (_ for _ in ()).throw(OSError("no locks here")))
    assert remove_abandoned(place) == []
    monkeypatch.undo()
    assert remove_abandoned(place) == [others[0]]
