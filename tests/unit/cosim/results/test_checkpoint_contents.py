"""Content of a checkpoint, and conditions for resuming a run from it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from inkloop.errors import ResultError
from inkloop.results import checkpoint
from inkloop.results.checkpoint import LAYERS_FOLDER, Checkpoints, last, layer_files, remove_layers


@pytest.fixture(autouse=True)
def all_states(monkeypatch: pytest.MonkeyPatch) -> None:
    """States are written however long that takes."""
    monkeypatch.setattr(checkpoint, "STATE_SHARE", 1.0)


def recorder_of() -> Any:
    """Rows with a number each, that are given back in the order in which they were written."""
    made = SimpleNamespace(layers=0, scanned=-1, taken=0, put=[])

    def take_rows() -> dict[str, Any]:
        made.taken += 1
        return {"row": np.array(made.taken)}

    made.take_rows = take_rows
    made.put_rows = lambda rows: made.put.append(int(rows["row"]))
    return made


def part(state: bytes | Exception | None = b"state", *, is_device: bool = False) -> Any:
    """A component with a state, one whose state cannot be saved, or one without."""

    def save() -> bytes:
        if isinstance(state, Exception):
            raise state
        return state or b""

    own = SimpleNamespace(is_device=is_device)
    if state is not None:
        own.save, own.restore = save, None
    return own


def names(folder: Path) -> list[str]:
    return [path.name for path in layer_files(folder)]


def test_state_is_that_of_the_communication_point(tmp_path: Path) -> None:
    recorder = recorder_of()
    written = Checkpoints(tmp_path, {"printer": part(b"ink"), "profiler": part(b"")}, recorder)
    height = np.arange(6.0).reshape(2, 3)
    outputs: Any = {"printer": {"height": height, "layers_printed": np.asarray(0)}}
    assert written.layer is None
    written.initialized(5, outputs)
    recorder.layers = 1
    written.stepped(7, {"printer": {"height": height + 1.0, "layers_printed": np.asarray(1)}})
    found = last(tmp_path)
    assert found is not None
    assert (found.time_ns, found.layer, found.file, found.refusal) == (7, 1, (1, 0), "")
    assert found.states == {"printer": b"ink", "profiler": b""}
    assert list(found.outputs) == ["printer", "profiler"]
    np.testing.assert_array_equal(found.outputs["printer"]["height"], height + 1.0)
    with pytest.raises(ValueError, match="read-only"):
        found.outputs["printer"]["height"][0, 0] = 3.0
    assert written.layer == 1


def test_scan_of_a_layer_has_a_file_of_its_own_and_nothing_new_has_none(tmp_path: Path) -> None:
    recorder = recorder_of()
    parts = {"printer": part()}
    written = Checkpoints(tmp_path, parts, recorder)
    written.initialized(0, {})
    for layers, scanned in ((0, -1), (0, 0), (1, 0), (1, 0), (1, 1), (2, 1)):
        recorder.layers, recorder.scanned = layers, scanned
        written.stepped(0, {})
    assert names(tmp_path) == ["0000.npz", "0000_1.npz", "0001.npz", "0001_1.npz", "0002.npz"]
    again = recorder_of()
    resumed = Checkpoints(tmp_path, parts, again)
    found = resumed.load()
    assert found is not None
    assert (found.layer, resumed.layer, again.put) == (2, 2, [1, 2, 3, 4, 5])
    again.layers, again.scanned = 2, 1
    resumed.initialized(0, {})  # nothing: these layers are on disk
    assert again.taken == 0
    again.scanned = 2
    resumed.stepped(0, {})
    assert names(tmp_path)[-1] == "0002_1.npz"


@pytest.mark.parametrize(
    ("component", "refusal"),
    [
        (part(None), "printer has no save and no restore"),
        (part(RuntimeError("of glass")), "printer cannot save its state: of glass"),
        (part(b"state"), ""),
    ],
)
def test_run_whose_state_cannot_be_saved_says_why(component: Any, refusal: str, tmp_path: Path) -> None:
    recorder = recorder_of()
    written = Checkpoints(tmp_path, {"printer": component}, recorder)
    written.initialized(0, {})
    found = last(tmp_path)
    assert found is not None
    assert written.refusal == found.refusal == refusal
    assert names(tmp_path) == ["0000.npz"]
    assert Checkpoints(tmp_path, {"printer": component}, recorder_of()).load() is not None


@pytest.mark.parametrize("is_device", [False, True])
def test_state_that_fails_later_leaves_the_last_one_unless_a_part_lies_on_a_stage(
    is_device: bool, tmp_path: Path
) -> None:
    recorder, own = recorder_of(), part(b"first", is_device=is_device)
    written = Checkpoints(tmp_path, {"printer": own}, recorder)
    written.initialized(0, {})

    def broken() -> bytes:
        raise RuntimeError("gone")

    own.save = broken
    recorder.layers = 1
    written.stepped(1, {})
    found = last(tmp_path)
    assert found is not None
    assert names(tmp_path) == ["0000.npz", "0001.npz"]
    expected = (1, "printer cannot save its state: gone") if is_device else (0, "")
    assert (found.layer, found.refusal) == expected
    assert written.refusal == expected[1]
    again = recorder_of()
    Checkpoints(tmp_path, {"printer": own}, again).load()
    assert names(tmp_path) == (["0000.npz", "0001.npz"] if is_device else ["0000.npz"])
    assert again.put == ([1, 2] if is_device else [1])


def test_state_that_can_be_saved_again_takes_the_refusal_back(tmp_path: Path) -> None:
    recorder, own = recorder_of(), part(RuntimeError("gone"))
    written = Checkpoints(tmp_path, {"printer": own}, recorder)
    written.initialized(0, {})
    assert written.refusal == "printer cannot save its state: gone"
    own.save = lambda: b"back"
    recorder.layers = 1
    written.stepped(1, {})
    found = last(tmp_path)
    assert found is not None
    assert (found.layer, found.refusal, written.refusal) == (1, "", "")


def test_state_of_a_device_is_written_for_every_layer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Between them, where Ctrl-C may end the run, a device need not have a state that can be saved."""
    monkeypatch.setattr(checkpoint, "STATE_SHARE", 1e-9)
    recorder = recorder_of()
    seconds = iter(float(n) for n in range(99))
    written = Checkpoints(tmp_path, {"printer": part(is_device=True)}, recorder, clock=lambda: next(seconds))
    written.initialized(0, {})
    for recorder.layers in (1, 2):
        written.stepped(recorder.layers, {})
        found = last(tmp_path)
        assert found is not None
        assert found.layer == recorder.layers
    written.interrupted(9, {})
    assert names(tmp_path) == ["0000.npz", "0001.npz", "0002.npz"]


def test_folder_without_layers_has_no_checkpoint(tmp_path: Path) -> None:
    assert last(tmp_path) is None
    assert Checkpoints(tmp_path, {"printer": part()}, recorder_of()).load() is None
    assert layer_files(tmp_path) == []
    remove_layers(tmp_path)
    Checkpoints(tmp_path, {"printer": part()}, recorder_of()).initialized(0, {})
    assert (tmp_path / LAYERS_FOLDER).is_dir()
    remove_layers(tmp_path)
    assert not (tmp_path / LAYERS_FOLDER).exists()


def test_layer_that_cannot_be_written_names_what_is_kept_and_how_to_continue(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    recorder = recorder_of()
    written = Checkpoints(tmp_path, {"printer": part()}, recorder)
    with monkeypatch.context() as patched:
        patched.setattr(checkpoint, "_save", full)
        with pytest.raises(ResultError, match="no layer was finished; make room, then continue with `inkloop resume"):
            written.initialized(0, {})
    written.initialized(0, {})
    recorder.layers = 1
    written.stepped(0, {})
    monkeypatch.setattr(checkpoint, "_save", full)
    recorder.layers = 2
    with pytest.raises(ResultError, match=r"0002\.npz: cannot be written: .*; layers 0 to 1 are kept"):
        written.stepped(0, {})
