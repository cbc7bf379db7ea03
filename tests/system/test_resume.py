"""A run that was stopped in any way resumes after its last layer, and ends as if it had not been stopped."""

from __future__ import annotations

import errno
import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import xarray as xr

from inkloop.cli import main
from inkloop.component import Port, Values
from inkloop.master.master import Master
from inkloop.results import array_file, checkpoint
from inkloop.results.checkpoint import Checkpoints, last
from inkloop.results.recorder import LayerRow, Recorder
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop.testing import job
from inkloop_controller.layer_controller import LayerController
from support.long_proofs import rest_is_long
from support.places import SCENARIOS
from support.prints import quick_cuboid
from support.toys import FunctionComponent

pytestmark = pytest.mark.usefixtures("without_pictures")

CUBOID = quick_cuboid()
SLOW = ["--set", "components.profiler.scan_duration_s=2.5", "--set", "part.height_um=36.0"]
KILLED = -signal.SIGKILL

# A run that kills itself at its n-th look: before, within and after the writing of each file, and in each step.
KILLING_RUN = """
import os, signal, sys
from pathlib import Path
from inkloop.cli import main
from inkloop.master.master import Master
from inkloop.results import array_file

at, looks = int(sys.argv[1]), 0

def look():
    global looks
    looks += 1
    if looks == at:
        os.kill(os.getpid(), signal.SIGKILL)

def watched(call):
    def before_and_after(*arguments, **options):
        look()
        answer = call(*arguments, **options)
        look()
        return answer
    return before_and_after

write_arrays = array_file.write_arrays
def write_by_halves(file, arrays):
    arrays = list(arrays)
    write_arrays(file, arrays[: len(arrays) // 2])
    file.flush()
    look()
    file.seek(0)
    file.truncate()
    write_arrays(file, arrays)

array_file.write_arrays = write_by_halves
Path.replace = watched(Path.replace)
Master._step = watched(Master._step)
code = main(sys.argv[2:])
print("looks", looks)
sys.exit(code)
"""


def run_killed_at(at: int, *words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", KILLING_RUN, str(at), *words, "--no-pictures"]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def assert_same_print(one: Path, other: Path) -> None:
    """Bit-equal in all that can be reproduced."""
    first, second = (
        dataset.drop_vars([name for name, array in dataset.variables.items() if "reproducible" in array.attrs])
        for dataset in (Result.load(folder).dataset for folder in (one, other))
    )
    xr.testing.assert_identical(first, second)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int]:
    """A run that is not killed, and how often it looked."""
    folder = tmp_path_factory.mktemp("whole") / "run"
    done = run_killed_at(0, "run", str(CUBOID), "--out", str(folder), *SLOW)
    assert done.returncode == 0, done.stderr
    return folder, int(done.stdout.split("looks")[1])


def kill_and_resume(whole: tuple[Path, int], share: float, folder: Path) -> None:
    reference, looks = whole
    at = 1 + round(share * (looks - 1))
    assert run_killed_at(at, "run", str(CUBOID), "--out", str(folder), *SLOW).returncode == KILLED
    if not (folder / "run.json").exists():
        assert at <= 7  # there was nothing yet to resume from
        return
    assert main(["resume", str(folder)]) == 0
    for place in (".", "compare/open-loop"):
        assert_same_print(folder / place, reference / place)
        assert not (folder / place / "layers").exists()


@pytest.mark.parametrize("share", rest_is_long([0.8, 0.0, 1.0, *((place + 0.5) / 30 for place in range(30))], 1))
def test_killed_run_resumes_to_the_same_end(whole: tuple[Path, int], share: float, tmp_path: Path) -> None:
    kill_and_resume(whole, share, tmp_path / "run")


@pytest.mark.long
def test_run_killed_twice_resumes_to_the_same_end(whole: tuple[Path, int], tmp_path: Path) -> None:
    folder = tmp_path / "run"
    assert run_killed_at(whole[1] // 5, "run", str(CUBOID), "--out", str(folder), *SLOW).returncode == KILLED
    assert run_killed_at(whole[1] // 5, "resume", str(folder)).returncode == KILLED
    assert main(["resume", str(folder)]) == 0
    assert_same_print(folder, whole[0])


def interrupt(
    monkeypatch: pytest.MonkeyPatch, folder: Path, *words: str, scenario: Path = CUBOID, at_layer: int = 2
) -> None:
    """Print up to a layer, then Ctrl-C: its state is kept even where states are rare."""

    def press(bar: object, row: LayerRow) -> None:
        if row.layer == at_layer:
            signal.raise_signal(signal.SIGINT)

    with monkeypatch.context() as patch:
        patch.setattr("inkloop.printing.run._LayerBar.__call__", press)
        patch.setattr(checkpoint, "STATE_SHARE", 1e-9)
        assert main(["run", str(scenario), "--no-isolate", "--out", str(folder), *words]) == 130


def test_interrupted_run_resumes_at_its_next_layer_to_the_same_end(
    whole: tuple[Path, int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With one scenario in memory: a second one would be refused where memory holds one only."""
    folder, layers, loaded, load = tmp_path / "run", list[int](), list[str](), Scenario.load
    interrupt(monkeypatch, folder, *SLOW)
    assert "continue with `inkloop resume" in capsys.readouterr().out
    assert Result.load(folder).dataset.sizes["layer"] == 3
    monkeypatch.setattr(Scenario, "load", lambda *words, **options: loaded.append("") or load(*words, **options))
    monkeypatch.setattr("inkloop.printing.run._LayerBar.__call__", lambda bar, row: layers.append(row.layer))
    assert main(["resume", str(folder)]) == 0
    assert_same_print(folder, whole[0])
    assert layers[0] == 3
    assert len(loaded) == 1


@pytest.mark.long
def test_events_continue_with_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario, short = SCENARIOS / "drifting-ink.toml", ["--no-compare", "--set", "part.height_um=150.0"]
    short += ["--set", "components.controller.horizon=2"]
    interrupt(monkeypatch, tmp_path / "run", *short, scenario=scenario, at_layer=13)
    assert main(["resume", str(tmp_path / "run")]) == 0
    assert main(["run", str(scenario), "--out", str(tmp_path / "reference"), *short]) == 0
    assert_same_print(tmp_path / "run", tmp_path / "reference")
    assert Result.load(tmp_path / "run").dataset.modified[[9, 10, -1]].values.tolist() == [False, True, True]


@pytest.mark.parametrize("fmi", rest_is_long(["3", "2"], 1))
def test_fmu_of_a_file_resumes_from_its_state(fmi: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The FMUs stand next to the scenario, not in the run folder."""
    words = ["export", "fmu", "LayerDeposition", "--fmi", fmi, "--nx", "12", "--ny", "12"]
    assert main([*words, "--out", str(tmp_path / "printer.fmu")]) == 0
    scenario = tmp_path / "mine.toml"
    ours = 'kind = "LayerDeposition"\nvariation = 0.2\nvariation_kind = "per_droplet"\n'
    text = CUBOID.read_text()
    assert ours in text
    scenario.write_text(text.replace(ours, 'kind = "Fmu"\nfile = "printer.fmu"\n'))
    interrupt(monkeypatch, tmp_path / "run", "--no-compare", scenario=scenario)
    assert main(["resume", str(tmp_path / "run"), "--no-isolate"]) == 0
    assert main(["run", str(scenario), "--out", str(tmp_path / "reference"), "--no-compare", "--no-isolate"]) == 0
    assert_same_print(tmp_path / "run", tmp_path / "reference")


def test_finished_run_is_not_changed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "run"
    main(["run", str(CUBOID), "--out", str(folder)])
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    assert main(["resume", str(folder)]) == 0
    assert "finished" in capsys.readouterr().out
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before
    (folder / "layers").mkdir()  # as if it was stopped between saving and removing them
    assert main(["resume", str(folder)]) == 0
    assert not (folder / "layers").exists()


def test_full_disk_keeps_the_layers_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, reference = tmp_path / "run", tmp_path / "reference"
    write = array_file.write_arrays

    def fill_up(file: Any, arrays: Any) -> None:
        write(file, arrays)
        if "0003.npz" in getattr(file, "name", ""):
            raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(array_file, "write_arrays", fill_up)
        assert main(["run", str(CUBOID), "--out", str(folder), "--no-compare"]) == 1
    message = capsys.readouterr().err
    assert "0003.npz: cannot be written: the disk is full; layers 0 to 2 are kept" in message
    assert sorted(path.name for path in (folder / "layers").iterdir()) == [
        "0000.npz",
        "0000_1.npz",
        "0001.npz",
        "0002.npz",
        "state.npz",
    ]
    assert main(["resume", str(folder)]) == 0
    assert main(["run", str(CUBOID), "--out", str(reference), "--no-compare"]) == 0
    assert_same_print(folder, reference)


def test_failed_component_leaves_its_layers_and_the_run_can_be_resumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, reference = tmp_path / "run", tmp_path / "reference"
    step = LayerController.do_step

    def fail(controller: LayerController, time_ns: int, step_ns: int, inputs: Values) -> Values:
        if int(inputs["layers_scanned"]) == 2:
            raise RuntimeError("no power")
        return step(controller, time_ns, step_ns, inputs)

    with monkeypatch.context() as patch:
        patch.setattr(LayerController, "do_step", fail)
        assert main(["run", str(CUBOID), "--out", str(folder), "--no-compare"]) == 1
    message = capsys.readouterr().err
    assert "no power" in message
    assert f"layers 0 to 2 are in {folder}; fix the cause, then continue with `inkloop resume {folder}`" in message
    assert Result.load(folder).stop_reason == "failed"
    assert main(["resume", str(folder)]) == 0
    assert main(["run", str(CUBOID), "--out", str(reference), "--no-compare"]) == 0
    assert_same_print(folder, reference)


def test_component_without_state_prints_to_the_end_and_is_not_resumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    monkeypatch.delattr(LayerController, "save")
    interrupt(monkeypatch, folder, "--no-compare")
    assert "cannot be resumed: controller has no save" in capsys.readouterr().out
    assert main(["run", str(CUBOID), "--out", str(tmp_path / "other"), "--no-compare"]) == 0
    assert Result.load(tmp_path / "other").stop_reason == "done"
    (folder / "result.nc").unlink()  # as after a kill
    assert main(["resume", str(folder)]) == 1
    assert "controller has no save; its layers 0 to 2 are in result.nc" in capsys.readouterr().err
    assert Result.load(folder).dataset.sizes["layer"] == 3


def test_folder_that_cannot_be_resumed_is_refused_with_a_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    assert main(["resume", str(folder)]) == 1
    assert "holds no run.json; name a folder" in capsys.readouterr().err
    interrupt(monkeypatch, folder, "--no-compare")
    record = json.loads((folder / "run.json").read_text())
    scenario = (folder / "scenario.toml").read_text()
    state = (folder / "layers" / "state.npz").read_bytes()

    def refusal() -> str:
        assert main(["resume", str(folder)]) == 1
        return capsys.readouterr().err

    (folder / "run.json").write_text(json.dumps({**record, "schema_version": 0}))
    assert "schema version is 0; this inkloop reads 1; run it again" in refusal()
    (folder / "run.json").write_text(json.dumps({key: record[key] for key in record if key != "scenario_file"}))
    assert "kept no state to resume from; run it again" in refusal()
    (folder / "run.json").write_text(json.dumps(record))
    (folder / "scenario.toml").write_text(scenario.replace("seed = 1", "seed = 2"))
    assert "scenario.toml: was changed since the run began; restore it" in refusal()
    (folder / "scenario.toml").write_text(scenario)
    (folder / "layers" / "state.npz").write_bytes(state[:100])
    assert f"remove {folder / 'layers'}, and the run begins at its first layer" in refusal()
    (folder / "layers" / "state.npz").write_bytes(state)
    assert main(["resume", str(folder)]) == 0


class Saved(FunctionComponent):
    """Remembers nothing."""

    def save(self) -> bytes:
        return b""

    def restore(self, saved: bytes) -> None:
        self.log.append("restore")


def test_component_without_outputs_resumes_too(tmp_path: Path) -> None:
    parts = {"printer": Saved(outputs=[Port("layers_printed", dtype="int32")]), "log": Saved()}
    points = Checkpoints(tmp_path, parts, Recorder(job(), parts))
    assert Master(parts, [], step_ns=1, observers=[points]).run(time_max_ns=1) == "time_max"
    point = last(tmp_path)
    assert point is not None
    assert Master(parts, [], step_ns=1).run(time_max_ns=1, resume=point) == "time_max"
    assert "restore" in parts["log"].log
