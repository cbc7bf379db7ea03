"""A disk without room is named, leaves nothing half done, and costs no finished layer."""

from __future__ import annotations

import errno
import io
import logging
import sys
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from inkloop.cli import main
from inkloop.component import DEVICE_LOGGER
from inkloop.errors import FmuError, ResultError
from inkloop.fmu import FmuComponent
from inkloop.fmu_writer.export import find_fmu
from inkloop.printing.on_devices import LOG_FILE, live_words
from inkloop.printing.print import Print
from inkloop.report.terminal import Terminal
from inkloop.results import array_file, checkpoint
from inkloop.results.checkpoint import LAYERS_FOLDER
from inkloop.results.layer_maps import LayerMaps
from inkloop.results.result import RESULT_FILE
from inkloop.scenario.file import Scenario
from support.places import ROOT

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows limits no sizes of files")
CHANGED = {"components.controller.horizon": 1, "run.layers_max": 3, "part.height_um": 20.0}


@contextmanager
def files_up_to(size: int) -> Iterator[None]:
    """No file grows beyond `size` bytes: writing fails as on a full disk, HDF5's too."""
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return Scenario.load(ROOT / "scenarios" / "cuboid.toml", CHANGED)


def largest(folder: Path) -> int:
    return max((path.stat().st_size for path in folder.rglob("*") if path.is_file()), default=0)


@pytest.mark.system
def test_disk_that_fills_at_any_file_is_named_and_the_run_resumes(scenario: Scenario, tmp_path: Path) -> None:
    """The limits are met by the first checkpoint, by the state after a layer, and by result.nc."""
    whole = Print(scenario).run()
    seen = set()
    for limit in (2_000, 4_000, 16_000, 32_000, 48_000, 64_000):
        folder = tmp_path / str(limit)
        printing = Print(scenario, folder)  # which unpacks its FMUs
        try:
            with files_up_to(limit):
                printing.run()
        except ResultError as error:
            message = str(error)
            assert "the file becomes larger than the disk or a limit (ulimit -f) allows" in message
            assert f"make room, then continue with `inkloop resume {folder}`" in message
            seen.add(RESULT_FILE if "cannot be saved" in message else LAYERS_FOLDER)
        else:
            seen.add("nothing")
        assert not list(folder.rglob("inkloop-part-*"))
        assert largest(folder) <= limit
        resumed = Print(scenario, folder).run()
        for name in ("height", "pattern", "measured_height"):
            np.testing.assert_array_equal(resumed.dataset[name], whole.dataset[name], err_msg=f"{limit} {name}")
    assert {LAYERS_FOLDER, RESULT_FILE} <= seen


@pytest.mark.parametrize(
    ("number", "reason"), [(errno.ENOSPC, "the disk is full"), (errno.EDQUOT, "the disk quota is used up")]
)
def test_checkpoint_without_room_names_the_disk(
    number: int, reason: str, scenario: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write, calls = array_file.write_arrays, []
    monkeypatch.setattr(checkpoint, "STATE_SHARE", 1.0)

    def filling(file: Any, arrays: Any) -> None:
        calls.append("state.npz" in str(getattr(file, "name", "")))
        if sum(calls) == 3:  # the first two are those after the start and after its scan
            raise OSError(number, "of the system")
        write(file, arrays)

    monkeypatch.setattr(array_file, "write_arrays", filling)
    with pytest.raises(ResultError, match=rf"state\.npz: cannot be written: {reason}; layers 0 to 0 are kept; make"):
        Print(scenario, tmp_path).run()
    monkeypatch.undo()
    resumed = Print(scenario, tmp_path).run()
    assert resumed.run["resumed_after_layer"] == 0


def test_result_without_memory_says_how_to_continue(
    scenario: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def lacking(*_: Any) -> None:
        raise MemoryError

    monkeypatch.setattr(LayerMaps, "added_to", lacking)
    with pytest.raises(ResultError, match=rf"{tmp_path}: the run cannot be saved: .*; make room, .* `inkloop resume"):
        Print(scenario, tmp_path).run()
    monkeypatch.undo()
    assert "resumed_after_layer" in Print(scenario, tmp_path).run().run


def test_fmu_for_which_the_temporary_disk_has_no_room_names_it(tmp_path: Path) -> None:
    path = find_fmu("LayerDeposition")
    with zipfile.ZipFile(path) as archive:
        size = max(member.file_size for member in archive.infolist() if member.filename.startswith("binaries/"))
    message = r"LayerDeposition\.fmu: cannot be unpacked, the file becomes larger .* set TMPDIR to a folder on another"
    with files_up_to(size // 2), pytest.raises(FmuError, match=message):
        FmuComponent(path)


def test_command_that_cannot_write_its_file_names_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "sensor.fmu"
    with files_up_to(5_000):
        assert main(["export", "fmu", "ProfileSensor", "--out", str(out)]) == 1
    error = capsys.readouterr().err
    assert "sensor.fmu" in error
    assert "the file becomes larger than the disk" in error
    assert list(tmp_path.iterdir()) == []


def test_log_of_devices_follows_no_link(tmp_path: Path) -> None:
    screen, target = io.StringIO(), tmp_path / "precious"
    target.write_text("precious")
    (tmp_path / LOG_FILE).symlink_to(target)
    with live_words(Terminal(screen, width=200, verbose=True), tmp_path):
        logging.getLogger(DEVICE_LOGGER).info("message")
    assert (
        "bench.log cannot be written: a link lies there, which is not followed; its messages are sh"
        in screen.getvalue()
    )
    assert target.read_text() == "precious"


def test_log_of_devices_without_room_is_reported_once(tmp_path: Path) -> None:
    screen = io.StringIO()
    console = Terminal(screen, width=200, verbose=True)
    log = logging.getLogger(DEVICE_LOGGER)
    with files_up_to(100), live_words(console, tmp_path):
        for number in range(20):
            log.info("message %d of a device", number)
    shown = screen.getvalue()
    assert "message 19 of a device" in shown
    assert shown.count("bench.log cannot be written: the file becomes larger than the disk") == 1
