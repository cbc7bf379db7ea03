"""Variables of one FMI type that are handed over in one call, by functions of the binary without a wrapper.

Small values go through one record that stays where it is: nothing is allocated for them in a step. A large map goes by
its own pointer, without a copy.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from inkloop.component import Port, Values
from inkloop.errors import ComponentError

LARGE_BYTES = 1 << 20
"""A map from here on is a group of its own."""


class Accessor(NamedTuple):
    """A function `fmi2GetReal`, `fmi3SetFloat64`, ... of a loaded binary, and its name."""

    name: str
    function: Any

    @classmethod
    def of(cls, dll: ctypes.CDLL, name: str) -> Accessor:
        """The function of that name; FMI 3 adds the number of values to the arguments."""
        arguments = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p]
        arguments += [ctypes.c_size_t] if name.startswith("fmi3") else []
        return cls(name, ctypes.CFUNCTYPE(ctypes.c_int, *arguments)((name, dll)))


class ValueGroup:
    """Ports of one FMI type and their values, end to end in the order of the ports.

    dtype: what the FMU takes and gives; references: value references of all ports.
    """

    def __init__(
        self, ports: Sequence[Port], dtype: str, references: Sequence[int], setter: Accessor, getter: Accessor
    ) -> None:
        self.names = ", ".join(port.name for port in ports)
        self.setter, self.getter = setter, getter
        self._ports, self._dtype = tuple(ports), np.dtype(dtype)
        self._references = (ctypes.c_uint * len(references))(*references)
        self._is_large = len(ports) == 1 and is_large(ports[0])
        self._record: NDArray[Any] = np.empty(0 if self._is_large else (), [_field(port, dtype) for port in ports])
        self._pointer = self._record.ctypes.data
        self._sent: bytes | None = None
        self._given = [(port.name, None if port.dtype == self._dtype else port.dtype) for port in ports]
        count = sum(int(np.prod(port.shape)) for port in ports)
        self._length = (count,) if getter.name.startswith("fmi3") else ()

    def set(self, component: int, values: Values) -> int:
        """Hand over a value for each port; returns the status. What the FMU has already is not handed over again.

        Raises ComponentError for a value of another shape.
        """
        if self._is_large:
            value = np.ascontiguousarray(self._value(self._ports[0], values), self._dtype)
            return self._called(self.setter, component, value.ctypes.data)
        for port in self._ports:
            self._record[port.name] = self._value(port, values)
        content = self._record.tobytes()
        if content == self._sent:
            return 0
        self._sent = None  # what is refused is handed over again
        status = self._called(self.setter, component, self._pointer)
        if status == 0:
            self._sent = content
        return status

    def get(self, component: int) -> tuple[int, Iterator[tuple[str, NDArray[Any]]]]:
        """Status and present values, read-only, in memory of their own."""
        if self._is_large:
            port = self._ports[0]
            values: NDArray[Any] = np.empty(port.shape, self._dtype)
            status = self._called(self.getter, component, values.ctypes.data)
            values = values.astype(port.dtype, copy=False)
            values.flags.writeable = False
            return status, iter([(port.name, values)])
        status = self._called(self.getter, component, self._pointer)
        self._sent = None
        record = self._record.copy()
        record.flags.writeable = False
        found = ((name, record[name], dtype) for name, dtype in self._given)
        return status, ((name, value if dtype is None else value.astype(dtype)) for name, value, dtype in found)

    def forget(self) -> None:
        """The FMU may hold other values than were handed over, as after its state was restored."""
        self._sent = None

    def _called(self, accessor: Accessor, component: int, pointer: int) -> int:
        arguments = (component, self._references, len(self._references), pointer, *self._length)
        status: int = accessor.function(*arguments)
        return status

    @staticmethod
    def _value(port: Port, values: Values) -> NDArray[Any]:
        value = np.asarray(values[port.name])
        if value.shape != port.shape:
            expected, found = (" x ".join(map(str, n)) or "a scalar" for n in (port.shape, value.shape))
            raise ComponentError(f"{port.name} takes {expected}, found {found}")
        return value


def is_large(port: Port) -> bool:
    """Whether a port is a group of its own."""
    return int(np.prod(port.shape)) * np.dtype(port.dtype).itemsize >= LARGE_BYTES


def _field(port: Port, dtype: str) -> tuple[str, str, tuple[int, ...]]:
    return (port.name, dtype, port.shape)
