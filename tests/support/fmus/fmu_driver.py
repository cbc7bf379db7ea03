"""Drives one of our FMUs call by call through FMPy's low-level classes, the same way for FMI 2 and FMI 3."""

from __future__ import annotations

import math
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from ctypes import CFUNCTYPE, c_char_p, c_int, c_void_p, cast
from functools import lru_cache
from pathlib import Path
from typing import Any, Self
from unittest.mock import patch

import fmpy
import numpy as np
import pytest
from fmpy import fmi2, fmi3
from fmpy.fmi1 import FMICallException

from inkloop.fmu_writer import archive
from inkloop.fmu_writer.export import export_fmu, find_fmu

OK, DISCARD, ERROR = 0, 2, 3
FORMS = ("fmi3", "fmi3-fixed", "fmi2")
EVERY_FORM = pytest.mark.parametrize("form", ["fmi3", "fmi2", pytest.param("fmi3-fixed", marks=pytest.mark.long)])
"""For what the binary does: that of fmi3-fixed is the one of fmi3."""
DEPOSITION_MODELS = ("LayerDeposition", "SuperpositionDeposition", "VolumeAreaDeposition", "YoungLaplaceDeposition")
MODELS = (*DEPOSITION_MODELS, "ProfileSensor", "LayerController")
FIXED_REALS = {**dict.fromkeys(MODELS, "pitch"), "LayerController": "h1_a"}
"""A real parameter of each that cannot be set any more once it runs."""
NUMPY_TYPES = {
    "Float64": np.float64,
    "Real": np.float64,
    "Int32": np.int32,
    "Integer": np.int32,
    "Int64": np.int64,
    "Boolean": np.bool_,
    "Enumeration": np.int64,
    "UInt64": np.uint64,
}

_folders: list[tempfile.TemporaryDirectory[str]] = []


@lru_cache
def _unpacked(model: str, form: str, nx: int, ny: int) -> tuple[Path, Any]:
    """The folder and the description of an FMU that fits the grid; FMI 3 with structural parameters fits any."""
    path = find_fmu(model, form)
    if form != "fmi3" and (nx, ny) != (9, 9):
        folder = tempfile.TemporaryDirectory()
        _folders.append(folder)
        path = Path(folder.name) / f"{model}.fmu"
        with patch.object(archive, "COMPRESSION", zipfile.ZIP_STORED):  # it is unpacked at once
            export_fmu(model, fmi="2" if form == "fmi2" else "3", nx=nx, ny=ny, fixed=True, out=path)
    folder = tempfile.TemporaryDirectory()
    _folders.append(folder)
    fmpy.extract(str(path), folder.name)
    return Path(folder.name), fmpy.read_model_description(folder.name)


LOGGER = CFUNCTYPE(None, c_void_p, c_char_p, c_int, c_char_p, c_char_p, c_char_p)
"""FMI 2 formats like printf; ours give "%s" and one text, on which fixed and variable arguments agree on Linux."""


def callbacks(messages: list[str]) -> fmi2.fmi2CallbackFunctions:
    """FMI 2 callbacks that collect what is logged and bring no memory functions."""
    logger = LOGGER(lambda _, name, status, category, form, text: messages.append(text.decode()))
    made = fmi2.fmi2CallbackFunctions()
    made.logger = cast(logger, fmi2.fmi2CallbackLoggerTYPE)
    made.kept = logger
    return made


class _Remembered:
    """FMPy reads the types of some sixty functions off its own methods for every instance; here once for each class."""

    _prototypes: Mapping[str, tuple[Any, Any, Any]] = {}
    dll: Any
    _functions: dict[str, Any]

    def _loadFunctions(self) -> None:
        if not self._prototypes:
            super()._loadFunctions()  # type: ignore[misc]
            found = {name: (f.argnames, f.argtypes, f.restype) for name, f in self._functions.items()}
            type(self)._prototypes = found
        for name, prototype in self._prototypes.items():
            function = self._functions[name] = getattr(self.dll, name)
            function.argnames, function.argtypes, function.restype = prototype


class FMU2(_Remembered, fmi2.FMU2Slave):
    """FMPy tells the versions apart by the beginning of the name of the class."""


class FMU3(_Remembered, fmi3.FMU3Slave):
    """As above."""


class Driver:
    """One instance; calls return the FMI status instead of raising, `messages` collects what it logs."""

    def __init__(self, model: str, form: str = "fmi3", nx: int = 9, ny: int = 9, folder: Path | None = None) -> None:
        self.is_fmi2 = form == "fmi2"
        self.nx, self.ny, self.intervals = nx, ny, 2
        unpacked, description = (
            (folder, fmpy.read_model_description(folder)) if folder else _unpacked(model, form, nx, ny)
        )
        load = FMU2 if self.is_fmi2 else FMU3
        self.fmu: Any = load(
            guid=description.guid, unzipDirectory=str(unpacked), modelIdentifier=model, instanceName="it"
        )
        self.messages: list[str] = []
        self.now = 0.0  # where the next layer's step begins
        self.references: dict[str, list[int]] = {}
        self.types: dict[str, str] = {}
        self.roles: dict[str, str] = {}
        for variable in description.modelVariables:
            name = variable.name.partition("[")[0]
            self.references.setdefault(name, []).append(variable.valueReference)
            self.types[name] = variable.type
            self.roles[name] = variable.causality
        known = [(v.name.partition("[")[0], v) for v in description.modelVariables]
        self.ranks = {name: len(v.dimensions) or (1 + v.name.count(",")) * ("[" in v.name) for name, v in known}
        if self.is_fmi2:
            self.callbacks = callbacks(self.messages)
            self.fmu.instantiate(callbacks=self.callbacks)
        else:
            self.fmu.instantiate(
                eventModeUsed=bool(description.coSimulation.hasEventMode),
                logMessage=lambda _, status, category, text: self.messages.append(text.decode()),
            )
        if form == "fmi3" and (nx, ny) != (9, 9):
            assert self.resize(nx, ny) == OK

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.fmu.freeInstance()

    def call(self, name: str, *arguments: Any) -> int:
        """The status of one of FMPy's methods."""
        return self._status(getattr(self.fmu, name), *arguments)

    def resize(self, nx: int, ny: int, intervals: int | None = None) -> int:
        """Set the structural parameters; the worst status."""
        sizes = {"nx": nx, "ny": ny} | ({} if intervals is None else {"region_intervals": intervals})
        statuses = [self.call("enterConfigurationMode")]
        statuses += [self.call("setUInt64", self.references[name], [size]) for name, size in sizes.items()]
        self.intervals = intervals or self.intervals
        return max(*statuses, self.call("exitConfigurationMode"))

    def set(self, name: str, value: Any) -> int:
        """Set a variable; a scalar fills a whole map."""
        values = np.broadcast_to(np.asarray(value), self.shape(name)).ravel().tolist()
        return self._status(self._accessor("set", name), self.references[name], values)

    def get(self, name: str) -> Any:
        """A variable's present value, as an array of its shape."""
        count = math.prod(self.shape(name))
        arguments = [self.references[name]] if self.is_fmi2 else [self.references[name], count]
        values = self._accessor("get", name)(*arguments)
        return np.array(values, NUMPY_TYPES[self.types[name]]).reshape(self.shape(name))[()]

    def shape(self, name: str) -> tuple[int, ...]:
        """(nx, ny) of a map, (intervals, nx, ny) of maps, () of a scalar."""
        sizes = (self.intervals, self.nx, self.ny)
        return sizes[len(sizes) - self.ranks[name] :]

    def enter(self, start: float = 0.0) -> int:
        """Enter Initialization Mode."""
        if not self.is_fmi2:
            return self._status(lambda: self.fmu.enterInitializationMode(startTime=start))
        return max(
            self._status(lambda: self.fmu.setupExperiment(startTime=start)), self.call("enterInitializationMode")
        )

    def exit(self) -> int:
        """Exit Initialization Mode."""
        return self.call("exitInitializationMode")

    def start(self, parameters: Mapping[str, Any] | None = None, start: float = 0.0) -> Self:
        """Set parameters or inputs and go through initialisation, all of which must succeed."""
        for name, value in (parameters or {}).items():
            assert self.set(name, value) == OK, (name, self.messages)
        assert max(self.enter(start), self.exit()) == OK, self.messages
        self.now = start
        return self

    def step(self, time: float, step: float = 1.0) -> int:
        """One communication step."""
        status = self.call("doStep", time, step)
        if status == OK:
            self.now = time + step
        return status

    def print_layer(self, pattern: Any = None) -> Any:
        """Command one layer in a step of 1 s; returns the new height."""
        layer = int(self.get("layers_printed")) + 1
        if pattern is not None:
            assert self.set("pattern", pattern) == OK
        assert self.set("layer_command", layer) == OK
        assert self.step(self.now) == OK, self.messages
        assert self.get("layers_printed") == layer
        return self.get("height")

    def save(self) -> bytes:
        """The serialized state."""
        state = self.fmu.getFMUState()
        try:
            return bytes(self.fmu.serializeFMUState(state))
        finally:
            self.fmu.freeFMUState(state)

    def restore(self, serialized: bytes) -> int:
        """Status of putting the instance into a serialized state."""
        try:
            state = self.fmu.deserializeFMUState(serialized)
        except FMICallException as error:
            return int(error.status)
        status = self.call("setFMUState", state)
        self.fmu.freeFMUState(state)
        return status

    def outputs(self) -> dict[str, Any]:
        """All variables that can be read, by name."""
        return {name: self.get(name) for name in self.references}

    def _accessor(self, verb: str, name: str) -> Callable[..., Any]:
        kind = self.types[name]
        kind = {"Enumeration": "Integer" if self.is_fmi2 else "Int64"}.get(kind, kind)
        method: Callable[..., Any] = getattr(self.fmu, f"{verb}{kind}")
        return method

    def _status(self, function: Callable[..., Any], *arguments: Any) -> int:
        try:
            function(*arguments)
        except FMICallException as error:
            return int(error.status)
        return OK


def equal(left: Mapping[str, Any], right: Mapping[str, Any]) -> bool:
    """True where all variables are the same bit by bit."""
    return left.keys() == right.keys() and all(np.array_equal(left[name], right[name]) for name in left)


def random_patterns(nx: int, ny: int, layers: int, seed: int = 3) -> list[Any]:
    """Random patterns of nothing, A and B."""
    generator = np.random.default_rng(seed)
    return [generator.integers(0, 3, (nx, ny)).astype(np.int32) for _ in range(layers)]
