"""The functions of an FMU's binary, with one interface for FMI 2 and FMI 3.

Built on FMPy's low-level classes, which load the binary and declare its functions. Every status worse than a warning
becomes a ComponentError with the messages that the FMU logged.
"""

from __future__ import annotations

import ctypes
import itertools
import logging
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

from fmpy import fmi2, fmi3
from fmpy.fmi1 import FMICallException, printLogMessage
from fmpy.logging import addLoggerProxy
from numpy.typing import NDArray

from inkloop.component import Port, Values
from inkloop.errors import ComponentError
from inkloop.fmu.description import FmuDescription
from inkloop.fmu.value_group import Accessor, ValueGroup, is_large
from inkloop.fmu.variable import DTYPES

WARNING, ERROR, FATAL = 1, 3, 4
_STATUS = ("OK", "a warning", "discard", "an error", "a fatal error", "pending")
_FMI2_WIRE = {"Real": "float64", "Integer": "int32", "Boolean": "int32", "Enumeration": "int32"}
_FMI2_FUNCTION = {"Enumeration": "Integer"}
_FMI3_FUNCTION = {"Enumeration": "Int64"}
_MESSAGES_KEPT = 20
_ENDED = "the FMU asks to end the simulation"

_log = logging.getLogger(__name__)


class Binding:
    """A loaded binary; `worst` is the highest status that it ever returned."""

    def __init__(self, description: FmuDescription, name: str, folder: Path) -> None:
        """Load the binary below `folder` for an instance of that name; raises the errors of the loader."""
        load = fmi2.FMU2Slave if description.fmi == 2 else fmi3.FMU3Slave
        self._fmi = description.fmi
        self._fmu: Any = load(
            guid=description.token,
            unzipDirectory=str(folder),
            modelIdentifier=description.identifier,
            instanceName=name,
        )
        self._description = description
        self._grouped: dict[tuple[str, ...], list[ValueGroup]] = {}
        self._recent: tuple[Sequence[Port] | None, list[ValueGroup]] = (None, [])
        self._before: tuple[Sequence[Port] | None, list[ValueGroup]] = (None, [])
        self._set_last: list[ValueGroup] = []
        self._messages: deque[tuple[int, str]] = deque(maxlen=_MESSAGES_KEPT)
        self._environment = next(_environments)
        self.worst = 0

    def instantiate(self) -> None:
        """Make the instance. Raises ComponentError."""
        try:
            if self._fmi == 2:
                self._fmu.instantiate(callbacks=_fmi2_callbacks(self._environment, self._hear), loggingOn=True)
            else:
                events = self._description.needs_events
                self._fmu.instantiate(loggingOn=True, eventModeUsed=events, logMessage=self._hear_fmi3)
        except Exception as error:  # FMPy raises a bare exception when the FMU returns no instance
            message = self._recent_messages()
            is_mixed = self._description.tool.startswith("inkloop ") and "instantiation token" in message
            advice = "; its parts are of two builds: run make, or pip install again, then export it again"
            raise ComponentError(f"the FMU made no instance{message}{advice if is_mixed else ''}") from error

    def configure(self, ports: Sequence[Port], values: Values) -> None:
        """Set structural parameters in Configuration Mode (FMI 3)."""
        self._call(None, self._fmu.enterConfigurationMode)
        self.set(ports, values)
        self._call(None, self._fmu.exitConfigurationMode)

    def enter_initialization(self, time: float) -> None:
        """Initialization Mode from `time` [s] on, without an end."""
        if self._fmi == 2:
            self._call(None, lambda: self._fmu.setupExperiment(startTime=time))
            self._call(None, self._fmu.enterInitializationMode)
        else:
            self._call(None, lambda: self._fmu.enterInitializationMode(startTime=time))

    def exit_initialization(self) -> None:
        """Step Mode, or Event Mode (`Events`); the outputs are those of the start time from here on."""
        self._call(None, self._fmu.exitInitializationMode)

    def set(self, ports: Sequence[Port], values: Values) -> None:
        """Set a value for each port, of the port's shape; one call for all of one type."""
        groups = self._groups(ports)
        if groups is not self._set_last:
            self._forget()  # other ports, of which some may be the same
            self._set_last = groups
        for group in groups:
            self._check(group.set(self._fmu.component, values), group.names, group.setter.name)

    def set_texts(self, values: Mapping[str, str]) -> None:
        """Set parameters that are texts, by name."""
        for name, text in values.items():
            self._call(name, self._fmu.setString, self._description.variables[name].references, [text])

    def get(self, ports: Sequence[Port]) -> dict[str, NDArray[Any]]:
        """The present value of each port, in memory of its own; one call for all of one type."""
        values: dict[str, NDArray[Any]] = {}
        for group in self._groups(ports):
            status, found = group.get(self._fmu.component)
            self._check(status, group.names, group.getter.name)
            values.update(found)
        return values

    def do_step(self, time: float, step: float) -> bool:
        """One communication step from `time` [s] on, in several calls where the FMU returns early (FMI 3).

        Returns whether the FMU asks for Event Mode.
        """
        self._messages.clear()
        end = time + step
        while True:
            try:
                answer = self._call(None, self._fmu.doStep, time, step)
            except ComponentError as error:
                if self._fmi == 2 and self._has_terminated():
                    raise ComponentError(f"{_ENDED}; {error}") from error
                raise
            if self._fmi == 2:
                return False
            is_event, has_terminated, is_early, reached = answer
            if has_terminated:
                raise ComponentError(f"{_ENDED}{self._recent_messages()}")
            if not is_early or reached >= end or (is_event and self._description.needs_events):
                return bool(is_event)
            if reached <= time:
                raise ComponentError(f"fmi3DoStep returned early at {reached:g} s, where the step began")
            time, step = reached, end - reached

    def save(self) -> bytes:
        """The serialized state."""
        state = self._call(None, self._fmu.getFMUState)
        measure, serialize = (
            (self._fmu.fmi2SerializedFMUstateSize, self._fmu.fmi2SerializeFMUstate)
            if self._fmi == 2
            else (self._fmu.fmi3SerializedFMUStateSize, self._fmu.fmi3SerializeFMUState)
        )
        size = ctypes.c_size_t()
        try:
            self._call(None, measure, self._fmu.component, state, ctypes.byref(size))
            content = _new_bytes(size.value)
            byte = fmi2.fmi2Byte if self._fmi == 2 else fmi3.fmi3Byte
            pointer = ctypes.cast(ctypes.c_char_p(content), ctypes.POINTER(byte))
            self._call(None, serialize, self._fmu.component, state, pointer, size.value)
        finally:
            self._fmu.freeFMUState(state)
        return content

    def restore(self, serialized: bytes) -> None:
        """Put the instance into a saved state."""
        self._forget()
        deserialize, byte, state = (
            (self._fmu.fmi2DeSerializeFMUstate, fmi2.fmi2Byte, fmi2.fmi2FMUstate())
            if self._fmi == 2
            else (self._fmu.fmi3DeserializeFMUState, fmi3.fmi3Byte, fmi3.fmi3FMUState())
        )
        pointer = ctypes.cast(ctypes.c_char_p(serialized), ctypes.POINTER(byte))  # FMPy's own call copies it
        self._call(None, deserialize, self._fmu.component, pointer, len(serialized), ctypes.byref(state))
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
        """Unload the binary."""
        _listeners.pop(self._environment, None)
        self._fmu.freeLibrary()

    def call(self, name: str, *arguments: Any) -> Any:
        """One of FMPy's methods. Raises ComponentError."""
        return self._call(None, getattr(self._fmu, name), *arguments)

    def _call(self, variables: str | None, function: Callable[..., Any], *arguments: Any) -> Any:
        try:
            return function(*arguments)
        except FMICallException as error:
            raise self._error(error.status, variables, error.function) from error

    def _check(self, status: int, variables: str, function: str) -> None:
        if status > WARNING:
            raise self._error(status, variables, function)

    def _error(self, status: int, variables: str | None, function: str) -> ComponentError:
        self.worst = max(self.worst, status)
        returned = _STATUS[status] if status < len(_STATUS) else f"status {status}"
        place = f"{variables}: " if variables else ""
        return ComponentError(f"{place}{function} returned {returned}{self._recent_messages(function)}")

    def _has_terminated(self) -> bool:
        """Whether a step that FMI 2 returned with discard has ended the simulation."""
        try:
            return self.worst < ERROR and bool(self._fmu.getBooleanStatus(fmi2.fmi2Terminated))
        except FMICallException:  # an FMU without the inquiry discards it too
            return False

    def _forget(self) -> None:
        for group in chain.from_iterable(self._grouped.values()):
            group.forget()

    def _groups(self, ports: Sequence[Port]) -> list[ValueGroup]:
        if ports is self._recent[0] or ports is self._before[0]:  # those of a step: inputs, outputs
            return self._recent[1] if ports is self._recent[0] else self._before[1]
        groups = self._groups_by_name(ports)
        self._recent, self._before = (ports, groups), self._recent
        return groups

    def _groups_by_name(self, ports: Sequence[Port]) -> list[ValueGroup]:
        key = tuple(port.name for port in ports)
        if key not in self._grouped:
            by_function: dict[tuple[str, str], list[Port]] = {}
            for port in ports:
                alone = port.name if is_large(port) else ""
                by_function.setdefault((self._function(port), alone), []).append(port)
            groups = by_function.items()
            self._grouped[key] = [self._group(function, members) for (function, _), members in groups]
        return self._grouped[key]

    def _function(self, port: Port) -> str:
        """The type in the names of the functions that get and set a port: "Float64", "Integer", ..."""
        kind = self._description.variables[port.name].type
        return (_FMI2_FUNCTION if self._fmi == 2 else _FMI3_FUNCTION).get(kind, kind)

    def _group(self, function: str, ports: Sequence[Port]) -> ValueGroup:
        variables = [self._description.variables[port.name] for port in ports]
        references = [reference for variable in variables for reference in variable.references]
        dtype = (_FMI2_WIRE if self._fmi == 2 else DTYPES)[variables[0].type]
        setter, getter = (Accessor.of(self._fmu.dll, f"fmi{self._fmi}{verb}{function}") for verb in ("Set", "Get"))
        return ValueGroup(ports, dtype, references, setter, getter)

    def _hear(self, status: int, message: bytes | None) -> None:
        text = (message or b"").decode("utf-8", "replace").strip()
        self._messages.append((status, text))
        if status == WARNING:
            _log.warning("%s: %s", self._fmu.instanceName, text)

    def _hear_fmi3(self, environment: object, status: int, category: bytes | None, message: bytes | None) -> None:
        self._hear(status, message)

    def _recent_messages(self, function: str = "") -> str:
        """Recent log messages of the FMU, only warnings and errors if there are any, without the function name."""
        complaints = [text for status, text in self._messages if status > WARNING]
        texts = [text.removeprefix(f"{function}: ") for text in complaints or [text for _, text in self._messages]]
        self._messages.clear()
        return f": {'; '.join(texts)}" if texts else " without a message"


def _new_bytes(size: int) -> bytes:
    """Uninitialised bytes for C code to write: a large state is neither cleared before nor copied."""
    content: bytes = _from_string_and_size(None, size)
    return content


_from_string_and_size = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_char_p, ctypes.c_ssize_t)(
    ("PyBytes_FromStringAndSize", ctypes.pythonapi)
)
_listeners: dict[int, Callable[[int, bytes | None], None]] = {}
_environments = itertools.count(1)


def _fmi2_callbacks(environment: int, listener: Callable[[int, bytes | None], None]) -> Any:
    """Callbacks of one instance.

    FMPy's proxy, which turns the logger's variable arguments into text, keeps one logger for the whole process;
    therefore all instances share one, which distinguishes them by their environment.
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
    if listener is None:  # an instance that other code made in this process
        printLogMessage(environment, name, status, category, message)
    else:
        listener(status, message)
