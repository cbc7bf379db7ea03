"""Layers on disk during a run: Ctrl-C costs no finished layer, a crash or a full disk those since the last state.

`layers/0007.npz` holds what was recorded up to layer 7 since the file before it, `layers/0007_1.npz` what followed
before layer 8, as its scan. `layers/state.npz` is the communication point after one of these files: time, outputs and
states of all components. Each file is there whole or not at all, and the state comes after its layer: a run resumes
from the state, no matter when it was stopped, and prints the layers after it again, if there are any. A scan is kept as
soon as it is there, for no real sensor would repeat it to the bit: the plan made from it is made again.
"""

from __future__ import annotations

import gc
import shutil
from collections import UserDict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from math import inf
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.component import Component, Values, is_device
from inkloop.errors import ResultError
from inkloop.files import reason_of, replaced, sync_folder
from inkloop.results import array_file
from inkloop.results.layer_maps import LayerMaps
from inkloop.results.recorder import Recorder

__all__ = ["LAYERS_FOLDER", "last"]

LAYERS_FOLDER, STATE_FILE = "layers", "state.npz"
STATE_SHARE = 0.1
"""Of the time of a print, at most, that its states take."""
_NEW_PART = (
    "its layers lie on the stage and cannot be printed again, and what was measured of them is lost: take the part "
    "off, `inkloop bench clear SCENARIO --give-up`, and begin a new part in a new folder. Keep this one as it is"
)


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A communication point: `outputs` of all components as the others see them, `states` as they saved them.

    Both may be in a file, and be read where they are used.

    layer: the last one printed by then; refusal: why no run can be resumed from here, empty if it can; file: the last
    file of layers by then, its layer and which one of that.
    """

    time_ns: int
    layer: int
    outputs: Mapping[str, Values]
    states: Mapping[str, bytes]
    refusal: str = ""
    file: tuple[int, int] = (0, 0)


class Checkpoints:
    """Observer of a master that writes a checkpoint per printed layer, and per scan, into the run folder `folder`.

    It stands after `recorder`, whose rows it writes. States take a tenth of the time at most: the layers after the last
    one are printed again by a resumed run. So they are where a component cannot save its state; if it never could, the
    checkpoint states why no run can be resumed from it. With a device, whose layers cannot be printed again, each
    checkpoint has its state, or states why not, and outlives a power failure too.

    clock: seconds, of which only differences count.
    """

    def __init__(
        self,
        folder: Path,
        components: Mapping[str, Component],
        recorder: Recorder,
        clock: Callable[[], float] = perf_counter,
    ) -> None:
        self._run_folder = folder
        self._folder = folder / LAYERS_FOLDER
        self._components = components
        self._recorder = recorder
        self._clock = clock
        self._durable = any(is_device(component) for component in components.values())
        self._file: tuple[int, int] | None = None  # the last one: layer, and which one of it
        self._scanned = -1
        self._holds_state = False
        self._state_ns, self._state_s, self._state_at = -1, 0.0, -inf
        self.refusal = ""

    @property
    def layer(self) -> int | None:
        """The last layer that is on disk, None if there is none."""
        return self._file[0] if self._file else None

    def initialized(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        """Write layer 0, or nothing if the run resumes from a checkpoint."""
        self._scanned = self._recorder.scanned
        if self._file is None:
            self._write(time_ns, outputs)

    def stepped(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        """Write a checkpoint if a layer has been printed or scanned."""
        if (self._recorder.layers, self._recorder.scanned) != (self.layer, self._scanned):
            self._write(time_ns, outputs)

    def interrupted(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        """Write the state of this point, if it is not on disk: Ctrl-C costs no layer."""
        if not self._durable:
            self.stopped(time_ns, outputs)

    def stopped(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        """Write the state of this point, from which a print goes on that its controller has stopped."""
        if self._state_ns != time_ns:
            self._state_at = -inf
            self._write(time_ns, outputs)

    def load(self) -> Checkpoint | None:
        """The last checkpoint, None if there is none; the recorder gets the rows of its layers. Raises ResultError."""
        advice = _NEW_PART if self._durable else f"remove {self._folder}, and the run begins at its first layer"
        checkpoint = last(self._run_folder, advice)
        if checkpoint is None:
            return None
        try:
            for path in layer_files(self._run_folder):
                if _place(path) > checkpoint.file:
                    path.unlink()  # its state was never written
                    continue
                with array_file.opened(path) as rows:
                    self._recorder.put_rows(rows)
        except array_file.UNREADABLE as error:
            raise _unreadable(self._folder, error, advice) from error
        self._file, self.refusal = checkpoint.file, checkpoint.refusal
        self._holds_state, self._state_ns, self._state_at = not checkpoint.refusal, checkpoint.time_ns, self._clock()
        return checkpoint

    def maps(self) -> LayerMaps:
        """The maps of all layers on disk, of which one file at a time is open."""

        def parts() -> Iterator[Mapping[str, NDArray[Any]]]:
            for path in layer_files(self._run_folder):
                with array_file.opened(path) as rows:
                    yield rows

        return self._recorder.maps(parts())

    def _write(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        layer = self._recorder.layers
        file = (layer, self._file[1] + 1) if self._file and self._file[0] == layer else (layer, 0)
        path = self._folder / (f"{layer:04d}_{file[1]}.npz" if file[1] else f"{layer:04d}.npz")
        try:
            if not self._folder.is_dir():
                self._folder.mkdir(parents=True)
                sync_folder(self._run_folder)
            _save(path, self._recorder.take_rows().items(), self._durable)
            path = self._folder / STATE_FILE
            if self._state_is_due():
                self._write_state(path, Checkpoint(time_ns, layer, outputs, {}, file=file))
        except (OSError, MemoryError) as error:
            kept = "no layer was finished" if self.layer is None else f"layers 0 to {self.layer} are kept"
            raise ResultError(
                f"{path}: cannot be written: {reason_of(error)}; {kept}; make room, then "
                f"continue with `inkloop resume {self._run_folder}`"
            ) from error
        self._file, self._scanned = file, self._recorder.scanned
        gc.collect(1)  # ctypes leaves maps in reference cycles; the collector counts objects, not their bytes

    def _state_is_due(self) -> bool:
        since = self._clock() - self._state_at
        return self._durable or self._state_s <= STATE_SHARE * (since + self._state_s)

    def _write_state(self, path: Path, point: Checkpoint) -> None:
        """Write the states, one of them in memory at a time; without them the reason, if there are none on disk."""
        begin = self._clock()
        try:
            _save(path, chain(_packed(point), _states(self._components)), self._durable)
        except _NoStateError as error:
            if not self._holds_state or self._durable:
                _save(path, _packed(replace(point, refusal=str(error))), self._durable)
                self.refusal = str(error)
            return
        self.refusal, self._holds_state = "", True
        self._state_ns, self._state_at = point.time_ns, self._clock()
        self._state_s = self._state_at - begin


class _NoStateError(Exception):
    """A component has no state to save; the message is the reason."""


def layer_files(run_folder: Path) -> list[Path]:
    """The files of the layers of a run that has not ended, in the order in which they were written."""
    return sorted((run_folder / LAYERS_FOLDER).glob("[0-9]*.npz"), key=_place)


def _place(path: Path) -> tuple[int, int]:
    layer, _, number = path.stem.partition("_")
    return int(layer), int(number or 0)


def last(run_folder: Path, advice: str = "") -> Checkpoint | None:
    """The last checkpoint of a run that is not finished, None if there is none.

    Raises ResultError with the advice; without one it refers to `inkloop resume`, which knows of devices.
    """
    folder = run_folder / LAYERS_FOLDER
    try:
        return _stored(folder / STATE_FILE) if (folder / STATE_FILE).is_file() else None
    except array_file.UNREADABLE as error:
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


def _states(components: Mapping[str, Component]) -> Iterator[tuple[str, NDArray[Any]]]:
    """States of the components, each made when it is asked for. Raises _NoStateError for one that has none."""
    for name, component in components.items():
        lacking = [member for member in ("save", "restore") if not hasattr(component, member)]
        if lacking:
            raise _NoStateError(f"{name} has no {' and no '.join(lacking)}")
        try:
            state = np.frombuffer(component.save(), np.uint8)  # type: ignore[attr-defined]
        except (Exception, SystemExit) as error:  # of others: anything may be raised; the run continues
            raise _NoStateError(f"{name} cannot save its state: {error}") from error
        yield f"state/{name}", state
        del state  # before the next one is made


def _packed(checkpoint: Checkpoint) -> Iterator[tuple[str, NDArray[Any]]]:
    """All but the states."""
    yield "point", np.array([checkpoint.time_ns, checkpoint.layer, *checkpoint.file], np.int64)
    yield "refusal", np.array(checkpoint.refusal)
    for name, values in checkpoint.outputs.items():
        yield from ((f"output/{name}/{port}", np.asarray(value)) for port, value in values.items())


class _Later(UserDict[str, Any]):
    """Values of components, each read when it is asked for: a print that resumes holds none of them."""

    def __getitem__(self, component: str) -> Any:
        return self.data[component]()


def _stored(path: Path) -> Checkpoint:
    """The checkpoint of a file, where outputs and states stay. Raises the errors in array_file.UNREADABLE."""
    ports, states = dict[str, list[str]](), dict[str, Any]()
    for key in array_file.check(path):
        kind, _, place = key.partition("/")
        if kind == "state":
            states[place] = partial(array_file.bytes_of, path, key)
            ports.setdefault(place, [])  # a component may have no output
        elif kind == "output":
            ports.setdefault(place.partition("/")[0], []).append(key)
    with array_file.opened(path) as stored:
        time_ns, layer, *file = (int(number) for number in stored["point"])
        refusal = str(stored["refusal"])
    outputs = {component: partial(_outputs, path, keys) for component, keys in ports.items()}
    return Checkpoint(time_ns, layer, _Later(outputs), _Later(states), refusal, (file[0], file[1]))


def _outputs(path: Path, keys: Iterable[str]) -> Values:
    with array_file.opened(path) as stored:
        found = {key.rpartition("/")[2]: stored[key] for key in keys}
    for value in found.values():
        value.flags.writeable = False  # consumers share it
    return found


def _save(path: Path, arrays: Iterable[tuple[str, NDArray[Any]]], durable: bool) -> None:
    with replaced(path, durable=durable) as partial, partial.open("wb") as file:
        array_file.write_arrays(file, arrays)
