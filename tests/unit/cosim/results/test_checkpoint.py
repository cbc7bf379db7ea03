"""A checkpoint that cannot be read: what is advised depends on whether a part lies on a stage."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from inkloop.errors import ResultError
from inkloop.results.checkpoint import LAYERS_FOLDER, STATE_FILE, Checkpoints, last


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
