"""One variable of an FMU: its type, shape and limits, and the conversion of outside values to it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.component import Port
from inkloop.limits import memory_error

DTYPES = {
    "Real": "float64", "Integer": "int32", "Boolean": "bool", "Enumeration": "int64",
    "Float64": "float64", "Float32": "float32",
    "Int8": "int8", "Int16": "int16", "Int32": "int32", "Int64": "int64",
    "UInt8": "uint8", "UInt16": "uint16", "UInt32": "uint32", "UInt64": "uint64",
    "String": "str",
}  # fmt: skip
"""FMI type -> NumPy dtype; binaries and clocks have none and take no part in the exchange."""
TEXT = "String"
"""The type of texts, which are exchanged as parameters alone."""
_DIMENSIONS_MAX = 64
"""Of an array in NumPy."""


@dataclass(frozen=True)
class Variable:
    """One variable of an FMU: `references` holds one value reference, or one per element where FMI 2 scatters an array.

    `elements` are the names of those scattered elements. `dimensions` are lengths, or names of structural parameters;
    `items` are the names of an enumeration's values.
    """

    name: str
    type: str
    causality: str
    variability: str
    references: tuple[int, ...]
    dimensions: tuple[int | str, ...] = ()
    unit: str = "1"
    start: tuple[str, ...] = ()
    minimum: str | None = None
    maximum: str | None = None
    items: Mapping[str, int] = field(default_factory=dict)
    description: str = ""
    elements: tuple[str, ...] = ()

    @property
    def dtype(self) -> str:
        """NumPy dtype of the values in memory: int32 for an enumeration whose numbers fit."""
        is_short = self.items and all(-(2**31) <= number < 2**31 for number in self.items.values())
        return "int32" if is_short else DTYPES[self.type]

    @property
    def is_settable(self) -> bool:
        """True for variables that may be set before the first step and are no inputs."""
        return self.causality in ("parameter", "structuralParameter") and self.variability in ("fixed", "tunable")

    @property
    def is_structural(self) -> bool:
        """True for parameters set in Configuration Mode: the sizes of arrays, and switches between forms of the
        model.
        """
        return self.causality == "structuralParameter"

    @property
    def is_size(self) -> bool:
        """True for a structural parameter that arrays may have as a dimension."""
        return self.is_structural and np.dtype(self.dtype).kind in "iu" and not self.items

    def shape(self, sizes: Mapping[str, int]) -> tuple[int, ...]:
        """Lengths along the dimensions, given the structural parameters."""
        return tuple(size if isinstance(size, int) else sizes[size] for size in self.dimensions)

    def fault(self, sizes: Mapping[str, int]) -> str | None:
        """The reason why its description makes no sense."""
        if unknown := [name for name in self.dimensions if isinstance(name, str) and name not in sizes]:
            return f"has the dimension {unknown[0]!r}, which is no constant, and no structural parameter with a start"
        shape = self.shape(sizes)
        if len(shape) > _DIMENSIONS_MAX or min(shape, default=1) < 0:
            return f"has the dimensions {' x '.join(map(str, shape))}"
        if self.type == TEXT:
            return None
        for what, texts, read in (
            ("the start value", set(self.start), self._checked_number),
            ("the limit", {limit for limit in (self.minimum, self.maximum) if limit is not None}, float),
        ):
            for text in texts:
                try:
                    read(text)
                except (ValueError, OverflowError):
                    return f"has {what} {text!r}; expected {self.type}"
        if len(self.start) not in (0, 1, math.prod(shape)):
            return f"has {len(self.start)} start values for {' x '.join(map(str, shape)) or 'one number'}"
        if not shape:
            return None
        reason = memory_error(math.prod(shape) * np.dtype(self.dtype).itemsize)
        return reason and f"of {' x '.join(map(str, shape))} values {reason}"

    def port(self, sizes: Mapping[str, int]) -> Port:
        """The variable as an input or output."""
        shape = self.shape(sizes)
        return Port(self.name, self.unit, shape, self.dtype, self._start(shape))

    def in_unit(self, unit: str, factor: float) -> Variable:
        """The same variable with its limits in another unit; factor: other unit to own unit."""
        if factor == 1.0:
            return self
        low, high = (
            None if limit is None else f"{float(limit) / factor:.12g}" for limit in (self.minimum, self.maximum)
        )
        return replace(self, unit=unit, minimum=low, maximum=high)

    def convert(self, value: object, sizes: Mapping[str, int]) -> NDArray[Any]:
        """`value`, in its unit, as an array of the variable's shape and dtype; ValueError names the expected form."""
        if self.type == TEXT:
            if not isinstance(value, str):
                raise ValueError(f"is {value!r}; {self._expected(sizes)}")
            return np.array(value)
        if isinstance(value, str):
            if value not in self.items:
                raise ValueError(f"is {value!r}; {self._expected(sizes)}")
            value = self.items[value]
        try:
            array = np.asarray(value)
        except ValueError as error:
            raise ValueError(f"is no array; {self._expected(sizes)}") from error
        shape = self.shape(sizes)
        wanted = np.dtype(self.dtype).kind
        if array.shape not in ((), shape) or array.dtype.kind not in {"f": "fiu", "b": "b"}.get(wanted, "iu"):
            raise ValueError(f"is {_show(array)}; {self._expected(sizes)}")
        low, high = self._limit(self.minimum, -np.inf), self._limit(self.maximum, np.inf)
        if wanted != "b" and not ((array >= low) & (array <= high) & np.isfinite(array)).all():
            raise ValueError(f"is {_show(array)}; {self._expected(sizes)}")
        if self.items and not np.isin(array, list(self.items.values())).all():
            raise ValueError(f"is {_show(array)}; {self._expected(sizes)}")
        return np.array(np.broadcast_to(array, shape), dtype=self.dtype, order="C")

    def _expected(self, sizes: Mapping[str, int]) -> str:
        if self.items:
            return f"expected one of {', '.join(f'{name!r} ({number})' for name, number in self.items.items())}"
        what = {"f": "a number", "b": "true or false", "U": "a text"}.get(np.dtype(self.dtype).kind, "a whole number")
        if self.minimum is not None and self.maximum is not None:
            what += f" in {self.minimum} .. {self.maximum}"
        elif self.minimum is not None or self.maximum is not None:
            what += f" >= {self.minimum}" if self.minimum is not None else f" <= {self.maximum}"
        if shape := self.shape(sizes):
            what += f", or {' x '.join(map(str, shape))} of them"
        return f"expected {what}" + (f" [{self.unit}]" if self.unit != "1" else "")

    def _start(self, shape: tuple[int, ...]) -> float | NDArray[Any]:
        """The start value; 0 where the description has none, or those of an array that has been resized."""
        if self.type == TEXT:
            return 0.0  # a parameter, which is no port
        numbers = {text: self._number(text) for text in self.start}
        if len(numbers) == 1:
            return next(iter(numbers.values()))
        if len(self.start) != math.prod(shape):
            return 0.0
        return np.array([numbers[text] for text in self.start], self.dtype).reshape(shape)

    def _limit(self, text: str | None, otherwise: float) -> float:
        return otherwise if text is None else float(text)

    def _checked_number(self, text: str) -> np.generic:
        made: np.generic = np.dtype(self.dtype).type(self._number(text))
        return made

    def _number(self, text: str) -> float:
        kind = np.dtype(self.dtype).kind
        return float(text) if kind == "f" else int({"true": 1, "false": 0}.get(text, text))


def summary(variable: Variable) -> str:
    dimensions = " x ".join(map(str, variable.dimensions))
    parts = [variable.type + (f" ({dimensions})" if dimensions else "")]
    if variable.unit != "1":
        parts.append(f"[{variable.unit}]")
    if variable.start and len(set(variable.start)) == 1:
        parts.append(f"= {variable.start[0]}")
    if variable.items:
        parts.append("{" + ", ".join(f"{number} {name}" for name, number in variable.items.items()) + "}")
    return " ".join(parts) + (f"  {variable.description}" if variable.description else "")


def _show(array: NDArray[Any]) -> str:
    if array.ndim == 0:
        return repr(array.item())
    values = f" from {array.min().item()!r} to {array.max().item()!r}" if array.size else ""
    return f"{' x '.join(map(str, array.shape))} values{values}"
