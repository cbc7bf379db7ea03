"""Two runs never write one folder: the second gets an error, and a run that is gone holds nothing."""

from __future__ import annotations

import os
import re
import signal
from pathlib import Path

import pytest

from inkloop.cli import main
from inkloop.errors import ResultError
from inkloop.printing.run import new_run_folder
from inkloop.results.lock import LOCK_FILE, sole_writer
from inkloop.results.result import Result
from support.other_process import HOLDING, other_process
from support.prints import quick_cuboid

pytestmark = pytest.mark.usefixtures("without_pictures")

CUBOID = quick_cuboid()
HOLDING_WITH_CHILD = """
import os, sys
from pathlib import Path
from inkloop.results.lock import sole_writer
with sole_writer(Path(sys.argv[1])):
    if os.fork() == 0:
        print("held", flush=True)
        sys.stdin.read()
        os._exit(0)
    sys.stdin.read()
"""
PLAIN = ("--no-compare", "--no-pictures")
STANDING_STILL = """
import sys
from inkloop.cli import main
from inkloop.printing.run import _LayerBar

def wait(bar, row):
    if row.layer == 2:
        print("held", flush=True)
        sys.stdin.read()

_LayerBar.__call__ = wait
sys.exit(main(sys.argv[1:]))
"""


def test_second_process_gets_the_process_id_of_the_first(tmp_path: Path) -> None:
    with other_process(HOLDING, str(tmp_path / "run")) as process:
        with pytest.raises(ResultError, match=rf"another run writes here, process {process.pid} since 20") as refused:
            sole_writer(tmp_path / "run").__enter__()
        assert f"`inkloop resume {tmp_path / 'run'}`" in str(refused.value)
        assert (tmp_path / "run" / LOCK_FILE).exists()


def test_folder_is_free_when_its_process_was_killed(tmp_path: Path) -> None:
    with other_process(HOLDING, str(tmp_path)) as process:
        process.send_signal(signal.SIGKILL)
        process.wait()
    assert (tmp_path / LOCK_FILE).exists()
    (tmp_path / "result").touch()
    with sole_writer(tmp_path):
        assert (tmp_path / LOCK_FILE).read_text().startswith("process ")
    assert [path.name for path in tmp_path.iterdir()] == ["result"]


def test_processes_started_meanwhile_do_not_hold_the_folder(tmp_path: Path) -> None:
    """The owner of the adapter, for example, may live a little longer than a run that was killed."""
    with other_process(HOLDING_WITH_CHILD, str(tmp_path)) as process:
        process.kill()
        process.wait()
        with sole_writer(tmp_path):
            assert f"process {process.pid} " not in (tmp_path / LOCK_FILE).read_text()


def test_folder_of_a_run_that_never_began_is_not_left(tmp_path: Path) -> None:
    with pytest.raises(ResultError, match="no bench"), sole_writer(tmp_path / "runs" / "cuboid"):
        raise ResultError("no bench")
    assert list((tmp_path / "runs").iterdir()) == []


def test_owner_of_a_folder_takes_the_place_of_a_longer_one_that_was_killed(tmp_path: Path) -> None:
    (tmp_path / LOCK_FILE).write_text("process 4000000000 since 2001-01-01 00:00:00 " + 40 * "x")
    with sole_writer(tmp_path):
        assert re.fullmatch(rf"process {os.getpid()} since [-\d]{{10}} [:\d]{{8}}", (tmp_path / LOCK_FILE).read_text())


def test_what_a_kill_leaves_of_a_lock_is_no_content(tmp_path: Path) -> None:
    (tmp_path / LOCK_FILE).write_text("process 1 since then")
    assert new_run_folder(tmp_path, "cuboid") == tmp_path


def test_resume_of_an_active_run_is_refused_and_changes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    with other_process(STANDING_STILL, "run", str(CUBOID), "--out", str(folder), *PLAIN) as process:
        before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        assert main(["resume", str(folder)]) == 1
        assert f"another run writes here, process {process.pid} since" in capsys.readouterr().err
        assert main(["run", str(CUBOID), "--out", str(folder)]) == 1
        assert f"`inkloop resume {folder}` continues it; name another --out" in capsys.readouterr().err
        assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before
        process.communicate("")
        assert process.returncode == 0
    assert Result.load(folder).stop_reason == "done"
    assert not (folder / LOCK_FILE).exists()


def test_killed_run_is_resumed_without_cleaning_up(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with other_process(STANDING_STILL, "run", str(CUBOID), "--out", str(folder), *PLAIN) as process:
        process.kill()
    assert (folder / LOCK_FILE).exists()
    assert main(["resume", str(folder)]) == 0
    assert Result.load(folder).stop_reason == "done"
    assert not (folder / LOCK_FILE).exists()
