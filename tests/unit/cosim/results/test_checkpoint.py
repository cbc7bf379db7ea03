"""A checkpoint that cannot be read: what is advised depends on whether a part lies on a stage."""

from __future__ import annotations

import tracemalloc
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from inkloop.errors import ResultError
from inkloop.results import checkpoint
from inkloop.results.checkpoint import LAYERS_FOLDER, STATE_FILE, Checkpoints, last, layer_files


@pytest.mark.parametrize("is_device", [False, True])
def test_advice_on_a_damaged_checkpoint_never_prints_over_a_part(is_device: bool, tmp_path: Path) -> None:
    (tmp_path / LAYERS_FOLDER).mkdir()
    (tmp_path / LAYERS_FOLDER / STATE_FILE).write_bytes(b"PK cut off")
    component: Any = SimpleNamespace(is_device=is_device)
    recorder: Any = None
    with pytest.raises(ResultError) as raised:
        Checkpoints(tmp_path, {"printer": component}, recorder).load()
    message = str(raised.value)
    assert message.startswith(f"{tmp_path / LAYERS_FOLDER}: cannot be read (")
    assert ("remove" in message, "the run begins at its first layer" in message) == (not is_device, not is_device)
    assert ("take the part off" in message, "a new folder" in message) == (is_device, is_device)


def test_reader_that_does_not_know_of_devices_gives_no_advice_of_its_own(tmp_path: Path) -> None:
    (tmp_path / LAYERS_FOLDER).mkdir()
    (tmp_path / LAYERS_FOLDER / STATE_FILE).write_bytes(b"PK cut off")
    with pytest.raises(ResultError, match=r"`inkloop resume .*` says what can be done$"):
        last(tmp_path)


def test_large_state_is_written_for_a_tenth_of_the_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Layers between two states are on disk, and are printed again by a run that is resumed."""
    monkeypatch.setattr(checkpoint, "LARGE_STATE", 1)
    time, saved = [0.0], list[int]()

    def save() -> bytes:
        time[0] += 2.0
        saved.append(recorder.layers)
        return b"state"

    part: Any = SimpleNamespace(save=save, restore=None, is_device=False)
    recorder: Any = SimpleNamespace(layers=0, scanned=-1, take_rows=lambda: {"row": np.array(recorder.layers)})
    written = Checkpoints(tmp_path, {"part": part}, recorder, clock=lambda: time[0])
    written.initialized(0, {})
    for layer in range(1, 8):
        recorder.layers, time[0] = layer, time[0] + 7.0
        written.stepped(layer, {})
    assert saved == [0, 3, 6], "18 s of printing for the 2 s of a state"
    assert [path.name for path in layer_files(tmp_path)] == [f"{layer:04d}.npz" for layer in range(8)]
    found = last(tmp_path)
    assert found is not None
    assert (found.layer, found.file, found.time_ns) == (6, (6, 0), 6)
    recorder.put_rows = lambda rows: None
    Checkpoints(tmp_path, {"part": part}, recorder).load()
    assert [path.name for path in layer_files(tmp_path)] == [f"{layer:04d}.npz" for layer in range(7)]


def test_files_of_layers_come_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    names = ["0002.npz", "0002_2.npz", "0002_10.npz", "9999.npz", "10000.npz", "10000_1.npz"]
    (tmp_path / LAYERS_FOLDER).mkdir()
    for name in names:
        (tmp_path / LAYERS_FOLDER / name).touch()
    assert [path.name for path in layer_files(tmp_path)] == names


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
    found = last(tmp_path)
    assert found is not None
    assert {len(state) for state in found.states.values()} == {size}
    tracemalloc.start()
    assert len(found.states["part 0"]) == size
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert size < peak < 1.5 * size + 2**20


@pytest.mark.parametrize("is_device", [False, True])
def test_older_state_is_kept_unless_a_part_lies_on_a_stage(is_device: bool, tmp_path: Path) -> None:
    """What a device has printed since then would be printed again."""
    states = [b"state"]
    part: Any = SimpleNamespace(save=lambda: states.pop(), restore=None, is_device=is_device)
    recorder: Any = SimpleNamespace(layers=0, scanned=-1, take_rows=lambda: {"row": np.array(recorder.layers)})
    written = Checkpoints(tmp_path, {"part": part}, recorder)
    written.initialized(0, {})
    recorder.layers = 1
    written.stepped(1, {})
    found = last(tmp_path)
    assert found is not None
    assert (found.layer, "part cannot save its state" in found.refusal) == ((1, True) if is_device else (0, False))
