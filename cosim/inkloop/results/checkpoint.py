"""Layers on disk during a run, so that Ctrl-C, a crash or a full disk costs no finished layer.

`layers/0007.npz` holds what was recorded up to layer 7 since the file before it, `layers/state.npz` the communication
point after the last of these files: time, outputs and states of all components. Each file is there whole or not at all,
and the state comes after its layer: a run resumes from the state, no matter when it was stopped. A scan is kept as
soon as it is there, for no real sensor would repeat it to the bit: the plan made from it is made again.
"""

from __future__ import annotations

import gc
import shutil
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from inkloop.component import Component, Values, is_device
from inkloop.errors import ResultError
from inkloop.files import reason_of, replaced, sync_folder
from inkloop.results.layer_maps import LayerMaps
from inkloop.results.recorder import Recorder

LAYERS_FOLDER, STATE_FILE = "layers", "state.npz"
_NEW_PART = (
    "its layers lie on the stage and cannot be printed again, and what was measured of them is lost: take the part "
    "off, `inkloop device SCENARIO clear --give-up`, and begin a new part in a new folder. Keep this one as it is"
)
_UNREADABLE = (OSError, ValueError, KeyError, BadZipFile)


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A communication point: `outputs` of all components as the others see them, `states` as they saved them.

    layer: the last one printed by then; refusal: why no run can be resumed from here, empty if it can.
    """

    time_ns: int
    layer: int
    outputs: Mapping[str, Values]
    states: Mapping[str, bytes]
    refusal: str = ""


class Checkpoints:
    """Observer of a master that writes a checkpoint per printed layer, and per scan, into the run folder `folder`.

    It stands after `recorder`, whose rows it writes. Where a component cannot save its state, the layers are written
    all the same; the last state that could be saved stays, and the layers after it are printed again by a resumed run.
    Without one the checkpoint states why it cannot be resumed, so does any with a device, whose layers cannot be
    printed again and whose checkpoints outlive a power failure too.
    """

    def __init__(self, folder: Path, components: Mapping[str, Component], recorder: Recorder) -> None:
        self._run_folder = folder
        self._folder = folder / LAYERS_FOLDER
        self._components = components
        self._recorder = recorder
        self._durable = any(is_device(component) for component in components.values())
        self._last: int | None = None
        self._scanned = -1
        self._rows: dict[str, NDArray[Any]] = {}
        self._holds_state = False
        self.refusal = ""

    @property
    def layer(self) -> int | None:
        """The last layer that is on disk, None if there is none."""
        return self._last

    def initialized(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        """Write layer 0, or nothing if the run resumes from a checkpoint."""
        self._scanned = self._recorder.scanned
        if self._last is None:
            self._write(time_ns, outputs)

    def stepped(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        """Write a checkpoint if a layer has been printed or scanned."""
        if (self._recorder.layers, self._recorder.scanned) != (self._last, self._scanned):
            self._write(time_ns, outputs)

    def load(self) -> Checkpoint | None:
        """The last checkpoint, None if there is none; the recorder gets the rows of its layers. Raises ResultError."""
        advice = _NEW_PART if self._durable else f"remove {self._folder}, and the run begins at its first layer"
        checkpoint = last(self._run_folder, advice)
        if checkpoint is None:
            return None
        try:
            for path in self._files():
                if int(path.stem) > checkpoint.layer:
                    path.unlink()  # its state was never written
                    continue
                with _opened(path) as rows:
                    self._recorder.put_rows(rows)
                    if int(path.stem) == checkpoint.layer:
                        self._rows = dict(rows)
        except _UNREADABLE as error:
            raise _unreadable(self._folder, error, advice) from error
        self._last, self.refusal = checkpoint.layer, checkpoint.refusal
        self._holds_state = not checkpoint.refusal
        return checkpoint

    def maps(self) -> LayerMaps:
        """The maps of all layers on disk, of which one file at a time is open."""

        def parts() -> Iterator[Mapping[str, NDArray[Any]]]:
            for path in self._files():
                with _opened(path) as rows:
                    yield rows

        return self._recorder.maps(parts())

    def _files(self) -> list[Path]:
        return sorted(self._folder.glob("[0-9]*.npz"), key=lambda path: int(path.stem))

    def _write(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        layer = self._recorder.layers
        self._rows = (self._rows if layer == self._last else {}) | self._recorder.take_rows()
        states, refusal = _states(self._components)
        stays = bool(refusal) and self._holds_state and not self._durable
        path = self._folder / f"{layer:04d}.npz"
        try:
            if not self._folder.is_dir():
                self._folder.mkdir(parents=True)
                sync_folder(self._run_folder)
            _save(path, self._rows, self._durable)
            path = self._folder / STATE_FILE
            if not stays:
                _save(path, _packed(Checkpoint(time_ns, layer, outputs, states, refusal)), self._durable)
                self.refusal, self._holds_state = refusal, not refusal
        except (OSError, MemoryError) as error:
            kept = "no layer was finished" if self._last is None else f"layers 0 to {self._last} are kept"
            raise ResultError(
                f"{path}: cannot be written: {reason_of(error)}; {kept}; make room, then "
                f"continue with `inkloop resume {self._run_folder}`"
            ) from error
        self._last, self._scanned = layer, self._recorder.scanned
        gc.collect(1)  # ctypes leaves maps in reference cycles; the collector counts objects, not their bytes


def last(run_folder: Path, advice: str = "") -> Checkpoint | None:
    """The last checkpoint of a run that is not finished, None if there is none.

    Raises ResultError with the advice; without one it refers to `inkloop resume`, which knows of devices.
    """
    folder = run_folder / LAYERS_FOLDER
    try:
        return _unpacked(_rows_of(folder / STATE_FILE)) if (folder / STATE_FILE).is_file() else None
    except _UNREADABLE as error:
        raise _unreadable(folder, error, advice or f"`inkloop resume {run_folder}` says what can be done") from error


def remove_layers(run_folder: Path) -> None:
    """Remove the checkpoints of a finished run, if there are any. Raises ResultError."""
    try:
        if (run_folder / LAYERS_FOLDER).is_dir():
            shutil.rmtree(run_folder / LAYERS_FOLDER)
    except OSError as error:
        raise ResultError(f"{run_folder / LAYERS_FOLDER}: cannot be removed: {error.strerror}; remove it") from error


def _unreadable(folder: Path, error: Exception, advice: str) -> ResultError:
    return ResultError(f"{folder}: cannot be read ({error}); {advice}")


def _states(components: Mapping[str, Component]) -> tuple[dict[str, bytes], str]:
    """States by component; why there is none, if one of them has none."""
    states: dict[str, bytes] = {}
    for name, component in components.items():
        lacking = [member for member in ("save", "restore") if not hasattr(component, member)]
        if lacking:
            return {}, f"{name} has no {' and no '.join(lacking)}"
        try:
            states[name] = component.save()  # type: ignore[attr-defined]
        except Exception as error:  # a third-party component may raise anything; the run continues without it
            return {}, f"{name} cannot save its state: {error}"
    return states, ""


def _packed(checkpoint: Checkpoint) -> dict[str, NDArray[Any]]:
    point = np.array([checkpoint.time_ns, checkpoint.layer], np.int64)
    packed = {"point": point, "refusal": np.array(checkpoint.refusal)}
    packed |= {f"state/{name}": np.frombuffer(state, np.uint8) for name, state in checkpoint.states.items()}
    for name, values in checkpoint.outputs.items():
        packed |= {f"output/{name}/{port}": np.asarray(value) for port, value in values.items()}
    return packed


def _unpacked(packed: Mapping[str, NDArray[Any]]) -> Checkpoint:
    time_ns, layer = (int(number) for number in packed["point"])
    states: dict[str, bytes] = {}
    outputs: dict[str, dict[str, NDArray[Any]]] = {}
    for key, value in packed.items():
        kind, _, rest = key.partition("/")
        if kind == "state":
            states[rest] = value.tobytes()
            outputs.setdefault(rest, {})  # a component may have none
        elif kind == "output":
            name, _, port = rest.partition("/")
            value.flags.writeable = False  # consumers share it
            outputs.setdefault(name, {})[port] = value
    return Checkpoint(time_ns, layer, outputs, states, str(packed["refusal"]))


def _save(path: Path, arrays: Mapping[str, NDArray[Any]], durable: bool) -> None:
    with replaced(path, durable=durable) as partial, partial.open("wb") as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]


def _opened(path: Path) -> AbstractContextManager[Mapping[str, NDArray[Any]]]:
    """The arrays of a file, each read when it is asked for."""
    opened: AbstractContextManager[Mapping[str, NDArray[Any]]] = np.load(path, allow_pickle=False)
    return opened


def _rows_of(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of a file by name, in memory. Raises OSError, ValueError, KeyError, BadZipFile."""
    with _opened(path) as stored:
        return dict(stored)
