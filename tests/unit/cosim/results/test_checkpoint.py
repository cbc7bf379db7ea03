"""Content of a checkpoint, when its state is written, and conditions for resuming a run from it."""

from __future__ import annotations

import tracemalloc
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from inkloop.errors import ResultError
from inkloop.results import checkpoint
from inkloop.results.checkpoint import LAYERS_FOLDER, STATE_FILE, Checkpoints, last, layer_files, remove_layers


@pytest.fixture(autouse=True)
def all_states(monkeypatch: pytest.MonkeyPatch) -> None:
    """States are written however long that takes."""
    monkeypatch.setattr(checkpoint, "STATE_SHARE", 1.0)


def found_in(folder: Path) -> checkpoint.Checkpoint:
    found = last(folder)
    assert found is not None
    return found


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
    found = found_in(tmp_path)
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
    found = found_in(tmp_path)
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
    found = found_in(tmp_path)
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
    found = found_in(tmp_path)
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
        assert found_in(tmp_path).layer == recorder.layers
    written.interrupted(9, {})
    assert names(tmp_path) == ["0000.npz", "0001.npz", "0002.npz"]


def test_folder_without_layers_has_no_checkpoint(tmp_path: Path) -> None:
    assert last(tmp_path) is None
    assert Checkpoints(tmp_path, {"printer": part()}, recorder_of()).load() is None
    assert layer_files(tmp_path) == []
    remove_layers(tmp_path)
    ordered = ["0002.npz", "0002_2.npz", "0002_10.npz", "9999.npz", "10000.npz", "10000_1.npz"]
    (tmp_path / LAYERS_FOLDER).mkdir()
    for name in ordered:
        (tmp_path / LAYERS_FOLDER / name).touch()
    assert names(tmp_path) == ordered
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


@pytest.mark.parametrize("is_device", [False, True])
def test_advice_on_a_damaged_checkpoint_never_prints_over_a_part(is_device: bool, tmp_path: Path) -> None:
    (tmp_path / LAYERS_FOLDER).mkdir()
    (tmp_path / LAYERS_FOLDER / STATE_FILE).write_bytes(b"PK cut off")
    component: Any = SimpleNamespace(is_device=is_device)
    recorder: Any = None
    with pytest.raises(ResultError) as raised:
        Checkpoints(tmp_path, {"printer": component}, recorder).load()
    with pytest.raises(ResultError, match=r"`inkloop resume .*` says what can be done$"):
        last(tmp_path)  # which knows nothing of devices
    message = str(raised.value)
    assert message.startswith(f"{tmp_path / LAYERS_FOLDER}: cannot be read (")
    assert ("remove" in message, "the run begins at its first layer" in message) == (not is_device, not is_device)
    assert ("take the part off" in message, "a new folder" in message) == (is_device, is_device)


def seven_layers(folder: Path) -> tuple[Checkpoints, Any, list[int]]:
    """The checkpoints of a print whose layers take 7 s and whose states take 2 s, its recorder, and the states' layers.

    States are saved at 0, 23 and 46 s.
    """
    checkpoint.STATE_SHARE = 0.1  # the fixture takes it back
    time, saved = [0.0], list[int]()

    def save() -> bytes:
        time[0] += 2.0
        saved.append(recorder.layers)
        return b"state"

    own: Any = SimpleNamespace(save=save, restore=None, is_device=False)
    recorder: Any = SimpleNamespace(layers=0, scanned=-1, take_rows=lambda: {"row": np.array(recorder.layers)})
    recorder.put_rows = lambda rows: None
    written = Checkpoints(folder, {"part": own}, recorder, clock=lambda: time[0])
    written.initialized(0, {})
    for layer in range(1, 8):
        recorder.layers, time[0] = layer, time[0] + 7.0
        written.stepped(layer, {})
    return written, recorder, saved


def test_states_take_a_tenth_of_the_time(tmp_path: Path) -> None:
    """Layers between two states are on disk, and are printed again by a run that is resumed."""
    written, recorder, saved = seven_layers(tmp_path)
    assert saved == [0, 3, 6], "18 s of printing for the 2 s of a state"
    assert [path.name for path in layer_files(tmp_path)] == [f"{layer:04d}.npz" for layer in range(8)]
    found = found_in(tmp_path)
    assert (found.layer, found.file, found.time_ns) == (6, (6, 0), 6)
    written.load()
    assert [path.name for path in layer_files(tmp_path)] == [f"{layer:04d}.npz" for layer in range(7)]
    written.interrupted(6, {})
    recorder.layers = 7
    written.interrupted(7, {})
    assert saved == [0, 3, 6, 7], "the state that was loaded is on disk"


def test_scan_after_the_last_state_is_no_part_of_it(tmp_path: Path) -> None:
    checkpoint.STATE_SHARE = 0.1  # the fixture takes it back
    time, recorder, again = [0.0], recorder_of(), recorder_of()

    def save() -> bytes:
        time[0] += 2.0
        return b"state"

    own: Any = SimpleNamespace(save=save, restore=None, is_device=False)
    written = Checkpoints(tmp_path, {"part": own}, recorder, clock=lambda: time[0])
    written.initialized(0, {})
    recorder.scanned = 0
    written.stepped(1, {})
    assert names(tmp_path) == ["0000.npz", "0000_1.npz"]
    Checkpoints(tmp_path, {"part": own}, again).load()
    assert (names(tmp_path), again.put) == (["0000.npz"], [1])


def test_run_that_is_interrupted_keeps_the_state_of_its_last_layer(tmp_path: Path) -> None:
    written, _, saved = seven_layers(tmp_path)
    for _ in range(2):
        written.interrupted(7, {})
    assert saved == [0, 3, 6, 7]
    found = found_in(tmp_path)
    assert (found.layer, found.file, found.time_ns) == (7, (7, 1), 7)


def test_one_state_at_a_time_is_in_memory(tmp_path: Path) -> None:
    size = 8_000_000
    parts: Any = {
        f"part {k}": SimpleNamespace(save=lambda: bytes(size), restore=None, is_device=False) for k in range(5)
    }
    recorder: Any = SimpleNamespace(layers=0, scanned=-1, take_rows=lambda: {})
    written = Checkpoints(tmp_path, parts, recorder)
    tracemalloc.start()
    written.initialized(0, {})
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert size < peak < 2.5 * size + 2**20
    found = found_in(tmp_path)
    assert {len(state) for state in found.states.values()} == {size}
    tracemalloc.start()
    assert len(found.states["part 0"]) == size
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert size < peak < 1.5 * size + 2**20
