"""A checkpoint that cannot be read: what is advised depends on whether a part lies on a stage."""

from __future__ import annotations

import tracemalloc
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from inkloop.errors import ResultError
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


def seven_layers(folder: Path) -> tuple[Checkpoints, Any, list[int]]:
    """The checkpoints of a print whose layers take 7 s and whose states take 2 s, its recorder, and the states' layers.

    States are saved at 0, 23 and 46 s.
    """
    time, saved = [0.0], list[int]()

    def save() -> bytes:
        time[0] += 2.0
        saved.append(recorder.layers)
        return b"state"

    part: Any = SimpleNamespace(save=save, restore=None, is_device=False)
    recorder: Any = SimpleNamespace(layers=0, scanned=-1, take_rows=lambda: {"row": np.array(recorder.layers)})
    recorder.put_rows = lambda rows: None
    written = Checkpoints(folder, {"part": part}, recorder, clock=lambda: time[0])
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
    found = last(tmp_path)
    assert found is not None
    assert (found.layer, found.file, found.time_ns) == (6, (6, 0), 6)
    written.load()
    assert [path.name for path in layer_files(tmp_path)] == [f"{layer:04d}.npz" for layer in range(7)]
    written.interrupted(6, {})
    recorder.layers = 7
    written.interrupted(7, {})
    assert saved == [0, 3, 6, 7], "the state that was loaded is on disk"


def test_run_that_is_interrupted_keeps_the_state_of_its_last_layer(tmp_path: Path) -> None:
    written, _, saved = seven_layers(tmp_path)
    for _ in range(2):
        written.interrupted(7, {})
    assert saved == [0, 3, 6, 7]
    found = last(tmp_path)
    assert found is not None
    assert (found.layer, found.file, found.time_ns) == (7, (7, 1), 7)


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
