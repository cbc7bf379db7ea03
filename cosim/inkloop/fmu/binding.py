"""The functions of an FMU's binary, in the same words for FMI 2 and FMI 3.

Built on FMPy's low-level classes, which load the binary and declare its functions. Every status worse than a warning
becomes a ComponentError that repeats what the FMU logged.
"""

from __future__ import annotations

import ctypes
import itertools
import logging
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from fmpy import fmi2, fmi3
from fmpy.fmi1 import FMICallException, printLogMessage
from fmpy.logging import addLoggerProxy
from numpy.typing import NDArray

from inkloop.errors import ComponentError
from inkloop.fmu.description import FmuDescription
from inkloop.fmu.variable import Variable

WARNING, ERROR, FATAL = 1, 3, 4
_STATUS = ("OK", "a warning", "discard", "an error", "a fatal error", "pending")
_FMI2_WIRE = {"Real": "float64", "Integer": "int32", "Boolean": "int32", "Enumeration": "int32"}
_FMI2_FUNCTION = {"Enumeration": "Integer"}
_FMI3_FUNCTION = {"Enumeration": "Int64"}
_MESSAGES_KEPT = 20

_log = logging.getLogger(__name__)


class Binding:
    """A loaded binary; `worst` is the highest status that it ever returned."""

    def __init__(self, description: FmuDescription, folder: Path) -> None:
        """Load the binary below `folder`; raises whatever the loader raises."""
        load = fmi2.FMU2Slave if description.fmi == 2 else fmi3.FMU3Slave
        self._fmi = description.fmi
        self._fmu: Any = load(
            guid=description.token,
            unzipDirectory=str(folder),
            modelIdentifier=description.identifier,
            instanceName=description.name,
        )
        self._slots: dict[str, _Slot] = {}
        self._messages: deque[tuple[int, str]] = deque(maxlen=_MESSAGES_KEPT)
        self._environment = next(_environments)
        self.worst = 0

    def instantiate(self) -> None:
        """Make the instance. Raises ComponentError."""
        try:
            if self._fmi == 2:
                self._fmu.instantiate(callbacks=_fmi2_callbacks(self._environment, self._hear), loggingOn=True)
            else:
                self._fmu.instantiate(loggingOn=True, logMessage=self._hear_fmi3)
        except Exception as error:  # FMPy raises a bare exception when the FMU returns no instance
            raise ComponentError(f"the FMU made no instance{self._said()}") from error

    def configure(self, structural: Sequence[tuple[Variable, NDArray[Any]]]) -> None:
        """Set structural parameters in Configuration Mode (FMI 3)."""
        self._call(None, self._fmu.enterConfigurationMode)
        for variable, value in structural:
            self.set(variable, value, value.shape)
        self._call(None, self._fmu.exitConfigurationMode)

    def enter_initialization(self, time: float) -> None:
        """Initialization Mode from `time` [s] on, without an end."""
        if self._fmi == 2:
            self._call(None, lambda: self._fmu.setupExperiment(startTime=time))
            self._call(None, self._fmu.enterInitializationMode)
        else:
            self._call(None, lambda: self._fmu.enterInitializationMode(startTime=time))

    def exit_initialization(self) -> None:
        """Step Mode; the outputs are those of the start time from here on."""
        self._call(None, self._fmu.exitInitializationMode)

    def set(self, variable: Variable, value: NDArray[Any], shape: tuple[int, ...]) -> None:
        """Hand over `value`, which must have the variable's shape; copied into a buffer that is kept."""
        if value.shape != shape:
            expected, found = (" x ".join(map(str, lengths)) or "a scalar" for lengths in (shape, value.shape))
            raise ComponentError(f"{variable.name} takes {expected}, found {found}")
        slot = self._slot(variable, shape)
        slot.buffer[...] = value
        self._call(variable.name, slot.setter, self._fmu.component, *slot.references, slot.pointer, *slot.length)

    def get(self, variable: Variable, shape: tuple[int, ...]) -> NDArray[Any]:
        """The present value as a fresh array."""
        slot = self._slot(variable, shape)
        array: NDArray[Any] = np.empty(shape, slot.buffer.dtype)
        pointer = slot.array_type.from_buffer(array)
        self._call(variable.name, slot.getter, self._fmu.component, *slot.references, pointer, *slot.length)
        return array if array.dtype == variable.dtype else array.astype(variable.dtype)

    def do_step(self, time: float, step: float) -> None:
        """One communication step from `time` [s] on."""
        self._messages.clear()
        answer = self._call(None, self._fmu.doStep, time, step)
        if self._fmi == 3 and answer[1]:
            raise ComponentError(f"the FMU asks to end the simulation{self._said()}")

    def save(self) -> bytes:
        """The serialized state."""
        state = self._call(None, self._fmu.getFMUState)
        try:
            return bytes(self._call(None, self._fmu.serializeFMUState, state))
        finally:
            self._fmu.freeFMUState(state)

    def restore(self, serialized: bytes) -> None:
        """Put the instance into a saved state."""
        state = self._call(None, self._fmu.deserializeFMUState, serialized)
        try:
            self._call(None, self._fmu.setFMUState, state)
        finally:
            self._fmu.freeFMUState(state)

    def terminate(self) -> None:
        """End of Step Mode, where the standard still allows it."""
        if self.worst < ERROR:
            self._call(None, self._fmu.terminate)

    def free(self) -> None:
        """Free the instance; after a fatal error the standard forbids every call."""
        if self.worst < FATAL:
            free = self._fmu.fmi2FreeInstance if self._fmi == 2 else self._fmu.fmi3FreeInstance
            free(self._fmu.component)

    def unload(self) -> None:
        """Let go of the binary."""
        _listeners.pop(self._environment, None)
        self._fmu.freeLibrary()

    def _call(self, variable: str | None, function: Callable[..., Any], *arguments: Any) -> Any:
        try:
            return function(*arguments)
        except FMICallException as error:
            self.worst = max(self.worst, error.status)
            status = _STATUS[error.status] if error.status < len(_STATUS) else f"status {error.status}"
            place = f"{variable}: " if variable else ""
            raise ComponentError(f"{place}{error.function} returned {status}{self._said(error.function)}") from error

    def _slot(self, variable: Variable, shape: tuple[int, ...]) -> _Slot:
        slot = self._slots.get(variable.name)
        if slot is None:
            slot = self._slots[variable.name] = _slot_of(self._fmu, self._fmi, variable, shape)
        return slot

    def _hear(self, status: int, message: bytes | None) -> None:
        text = (message or b"").decode("utf-8", "replace").strip()
        self._messages.append((status, text))
        if status == WARNING:
            _log.warning("%s: %s", self._fmu.instanceName, text)

    def _hear_fmi3(self, environment: object, status: int, category: bytes | None, message: bytes | None) -> None:
        self._hear(status, message)

    def _said(self, function: str = "") -> str:
        """What the FMU logged of late, complaints only if there are any, without the name of the function again."""
        complaints = [text for status, text in self._messages if status > WARNING]
        texts = [text.removeprefix(f"{function}: ") for text in complaints or [text for _, text in self._messages]]
        self._messages.clear()
        return f": {'; '.join(texts)}" if texts else " without a message"


@dataclass(frozen=True)
class _Slot:
    """What it takes to hand one variable over: functions, references, and a buffer with a pointer to it."""

    setter: Callable[..., Any]
    getter: Callable[..., Any]
    references: tuple[ctypes.Array[Any], int]
    buffer: NDArray[Any]
    array_type: Any
    pointer: ctypes.Array[Any]
    length: tuple[()] | tuple[int]


def _slot_of(fmu: Any, fmi: int, variable: Variable, shape: tuple[int, ...]) -> _Slot:
    prefix, functions = ("fmi2", _FMI2_FUNCTION) if fmi == 2 else ("fmi3", _FMI3_FUNCTION)
    function = functions.get(variable.type, variable.type)
    buffer: NDArray[Any] = np.empty(shape, _FMI2_WIRE[variable.type] if fmi == 2 else variable.dtype)
    array_type = np.ctypeslib.as_ctypes_type(buffer.dtype) * buffer.size
    count = len(variable.references)
    return _Slot(
        setter=getattr(fmu, f"{prefix}Set{function}"),
        getter=getattr(fmu, f"{prefix}Get{function}"),
        references=((ctypes.c_uint * count)(*variable.references), count),
        buffer=buffer,
        array_type=array_type,
        pointer=array_type.from_buffer(buffer),
        length=() if fmi == 2 else (buffer.size,),
    )


_listeners: dict[int, Callable[[int, bytes | None], None]] = {}
_environments = itertools.count(1)


def _fmi2_callbacks(environment: int, listener: Callable[[int, bytes | None], None]) -> Any:
    """Callbacks of one instance.

    FMPy's proxy, which turns the logger's variable arguments into text, keeps one logger for the whole process;
    therefore all instances share one, which tells them apart by their environment.
    """
    _listeners[environment] = listener
    callbacks = fmi2.fmi2CallbackFunctions()
    callbacks.logger = _shared_logger
    callbacks.allocateMemory = fmi2.defaultCallbacks.allocateMemory
    callbacks.freeMemory = fmi2.defaultCallbacks.freeMemory
    callbacks.componentEnvironment = environment
    addLoggerProxy(ctypes.byref(callbacks))
    return callbacks


@fmi2.fmi2CallbackLoggerTYPE  # type: ignore[untyped-decorator]  # ctypes function types are untyped
def _shared_logger(environment: int | None, name: bytes, status: int, category: bytes, message: bytes) -> None:
    listener = _listeners.get(environment or 0)
    if listener is None:  # an instance that someone else made in this process
        printLogMessage(environment, name, status, category, message)
    else:
        listener(status, message)
