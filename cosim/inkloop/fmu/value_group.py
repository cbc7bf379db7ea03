"""Variables of one FMI type that are set or read in one call, by functions of the binary without a wrapper.

Small values go through one record that stays where it is. Unchanged values are not set again, and are returned as the
arrays of the last call. A large map is passed by its own pointer, without a copy.
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
"""Size in bytes from which a map forms a group of its own."""


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

    dtype: type of the FMU's values; references: value references of all ports.
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
        self._fields = [] if self._is_large else [(port, port.name, self._record[port.name]) for port in ports]
        self._sent: bytes | None = None
        self._received: bytes | None = None
        self._values: dict[str, NDArray[Any]] = {}
        count = sum(int(np.prod(port.shape)) for port in ports)
        self._arguments = (self._references, len(references), self._record.ctypes.data)
        self._length = (count,) if getter.name.startswith("fmi3") else ()

    def set(self, component: int, values: Values) -> int:
        """Set a value for each port; returns the status. Values that the FMU already has are not set again.

        Raises ComponentError for a value of another shape.
        """
        if self._is_large:
            value = np.ascontiguousarray(_fitting(self._ports[0], values), self._dtype)
            return self._called_large(self.setter, component, value)
        for port, name, field in self._fields:
            value = values[name]
            field[...] = value if type(value) is np.ndarray and value.shape == field.shape else _fitting(port, values)
        content = self._record.tobytes()
        if content == self._sent:
            return 0
        self._sent = None  # refused values are set again
        status: int = self.setter.function(component, *self._arguments, *self._length)
        if status == 0:
            self._sent = content
        return status

    def get(self, component: int) -> tuple[int, dict[str, NDArray[Any]]]:
        """Status and present values, which nothing can change: the same arrays as long as the FMU gives the same."""
        if self._is_large:
            port = self._ports[0]
            values: NDArray[Any] = np.empty(port.shape, self._dtype)
            status = self._called_large(self.getter, component, values)
            values = values.astype(port.dtype, copy=False)
            values.flags.writeable = False
            return status, {port.name: values}
        status = self.getter.function(component, *self._arguments, *self._length)
        self._sent = None
        content = self._record.tobytes()
        if content != self._received:
            self._received = content
            self._values = dict(self._arrays(content))
        return status, self._values

    def forget(self) -> None:
        """Forget the values of the FMU, which may differ after its state was restored."""
        self._sent = None

    def _called_large(self, accessor: Accessor, component: int, values: NDArray[Any]) -> int:
        arguments = (self._references, len(self._references), values.ctypes.data)
        status: int = accessor.function(component, *arguments, *self._length)
        return status

    def _arrays(self, content: bytes) -> Iterator[tuple[str, NDArray[Any]]]:
        """The values of the ports in bytes that the FMU wrote; those of its own type without a copy."""
        first = 0
        for port, name, field in self._fields:
            value: NDArray[Any] = np.ndarray(field.shape, self._dtype, content, first)
            first += field.nbytes
            yield (
                name,
                value
                if port.dtype == self._dtype
                else np.ndarray(field.shape, port.dtype, value.astype(port.dtype).tobytes()),
            )


def _fitting(port: Port, values: Values) -> NDArray[Any]:
    """The value of a port, in its shape. Raises ComponentError."""
    value = np.asarray(values[port.name])
    if value.shape != port.shape:
        expected, found = (" x ".join(map(str, n)) or "a scalar" for n in (port.shape, value.shape))
        raise ComponentError(f"{port.name} takes {expected}, found {found}")
    return value


def is_large(port: Port) -> bool:
    """Whether a port forms a group of its own."""
    return int(np.prod(port.shape)) * np.dtype(port.dtype).itemsize >= LARGE_BYTES


def _field(port: Port, dtype: str) -> tuple[str, str, tuple[int, ...]]:
    return (port.name, dtype, port.shape)
