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
from inkloop.files import installed_file

_DTYPES = {"real": "float64", "integer": "int32", "boolean": "bool", "enumeration": "int64", "count": "uint64"}


@dataclass(frozen=True)
class Variable:
    """One variable: type, shape ("scalar", "grid"), unit, start value and limits in SI.

    items: word -> number of an enumeration; absent, unlimited, needs, scenario: see variables.toml.
    """

    name: str
    description: str
    causality: str = "parameter"
    type: str = "real"
    shape: str = "scalar"
    unit: str = "1"
    start: Any = 0
    min: float = -inf
    max: float = inf
    absent: str = ""
    unlimited: bool = False
    needs: str = ""
    scenario: str = ""
    items: Mapping[str, int] = field(default_factory=dict)

    @property
    def dtype(self) -> str:
        """NumPy's name of the type of a value."""
        return _DTYPES[self.type]

    @property
    def default(self) -> Any:
        """The value at the start in Python: a word of an enumeration; None or infinity where it is no value."""
        if self.absent:
            return inf if self.unlimited else None
        if self.items:
            return next(word for word, number in self.items.items() if number == self.start)
        return bool(self.start) if self.type == "boolean" else self.start

    @property
    def least(self) -> float:
        """The smallest value in Python; below it, or at it, lies what stands for none."""
        if not self.absent or self.start != self.min:
            return self.min
        return self.min + 1 if self.type == "integer" else max(self.min, 0.0)

    @property
    def is_above_least(self) -> bool:
        """Whether the smallest value itself is not allowed, for it stands for none."""
        return bool(self.absent) and self.type == "real" and self.start == self.min == 0.0

    def number(self, value: Any) -> Any:
        """A value of Python for C."""
        if value is None or (self.unlimited and value == inf):
            return self.start
        return self.items[value] if isinstance(value, str) else value

    def errors(self, value: Any, name: str = "") -> list[str]:
        """The error of a value of Python in SI, which may be called by another name."""
        if value is None or (self.unlimited and value == inf):
            return []
        if self.items:
            is_allowed, shown = value in self.items, repr(value)
        else:
            is_allowed, shown = (self.least <= value <= self.max) and value != inf, f"{value}"
            is_allowed = is_allowed and not (self.is_above_least and value == self.least)
        return [] if is_allowed else [f"{name or self.name} is {shown}; needs {self.needs or self._range()}"]

    def port(self, shape: tuple[int, int]) -> Port:
        """An input or output on a grid of (nx, ny) cells; a signal of the layer contract as that states it."""
        if self.name in SIGNALS:
            return SIGNALS[self.name].port(shape)
        return Port(self.name, self.unit, shape if self.shape == "grid" else (), self.dtype, self.start)

    def _range(self) -> str:
        if self.items:
            *words, last = (f'"{word}"' for word in self.items)
            return f"{', '.join(words)} or {last}"
        if self.max == inf:
            return f"at least {self.least:g}"
        return f"a value of {self.least:g} to {self.max:g}"


@cache
def options() -> Mapping[str, Variable]:
    """The variables, and the options that the controller in Python alone has. Raises InkloopError without the file."""
    with installed_file("inkloop_controller", "variables.toml").open("rb") as file:
        table = tomllib.load(file)
    known = {each.name for each in fields(Variable)}
    python = {name: {"causality": "python", **entry} for name, entry in table["python"].items()}
    found = {}
    for name, entry in {**table["variables"], **python}.items():
        items = table["types"][entry["declared"]]["items"] if "declared" in entry else {}
        found[name] = Variable(name, **{"items": items, **{key: entry[key] for key in entry.keys() & known}})
    return found


@cache
def variables() -> Mapping[str, Variable]:
    """The variables by name, in the order of the pointers that C takes."""
    return {name: each for name, each in options().items() if each.causality != "python"}
