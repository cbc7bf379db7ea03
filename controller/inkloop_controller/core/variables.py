"""The variables of the layer controller, as variables.toml of LayerController states them: options, inputs, outputs."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cache
from math import inf
from typing import Any

from inkloop.component import Port
from inkloop.contract import SIGNALS
from inkloop.errors import InkloopError
from inkloop.files import installed_file
from inkloop_controller.core.library import library

_DTYPES = {"real": "float64", "integer": "int32", "boolean": "bool", "enumeration": "int64", "count": "uint64"}


@dataclass(frozen=True)
class Variable:
    """One variable: type, shape ("scalar", "grid"), unit, start value and limits in SI.

    items: word -> number of an enumeration; absent: what stands for the start value where that is no value (None or
    infinity in Python); scenario: meaning on the page of the scenario file, where it is not the description.
    """

    name: str
    causality: str
    description: str
    type: str = "real"
    shape: str = "scalar"
    unit: str = "1"
    start: float = 0
    min: float = -inf
    max: float = inf
    absent: str = ""
    scenario: str = ""
    items: Mapping[str, int] = field(default_factory=dict)

    @property
    def dtype(self) -> str:
        """NumPy's name of the type of a value."""
        return _DTYPES[self.type]

    @property
    def default(self) -> Any:
        """The value at the start in Python: a word of an enumeration, None for none."""
        if self.absent:
            return None
        if self.items:
            return next(word for word, number in self.items.items() if number == self.start)
        return bool(self.start) if self.type == "boolean" else self.start

    def number(self, value: Any) -> Any:
        """A value of Python for C."""
        if value is None or (self.absent and value == inf):
            return self.start
        return self.items[value] if isinstance(value, str) else value

    def port(self, shape: tuple[int, int]) -> Port:
        """An input or output on a grid of (nx, ny) cells; a signal of the layer contract as that states it."""
        if self.name in SIGNALS:
            return SIGNALS[self.name].port(shape)
        return Port(self.name, self.unit, shape if self.shape == "grid" else (), self.dtype, self.start)


@cache
def variables() -> Mapping[str, Variable]:
    """The variables by name, in the order of the pointers that C takes.

    Raises InkloopError if the file is not installed, or is that of another build than the library.
    """
    with installed_file("inkloop_controller", "variables.toml").open("rb") as file:
        table = tomllib.load(file)
    found = _read(table["variables"], table["types"])
    if len(found) != library().inkloop_variables():
        raise InkloopError("variables.toml is not of the same build as the core; run make, or pip install again")
    return found


def _read(entries: Mapping[str, Mapping[str, Any]], types: Mapping[str, Mapping[str, Any]]) -> dict[str, Variable]:
    known = {each.name for each in fields(Variable)}
    return {
        name: Variable(
            name,
            items=types[entry["declared"]]["items"] if "declared" in entry else {},
            **{key: value for key, value in entry.items() if key in known},
        )
        for name, entry in entries.items()
    }
