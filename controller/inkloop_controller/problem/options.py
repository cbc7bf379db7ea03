"""Variables of the layer controller as variables.toml of LayerController states them, and its options in a scenario:
keyword arguments of the classes that it is made of, marked where they stand.

A scenario writes an argument with a unit in the unit of its key: `overshoot_limit` [m] as `overshoot_limit_um`, and
leaves out what is infinite or None.
"""

from __future__ import annotations

import inspect
import tomllib
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import cache, wraps
from math import inf, isinf
from numbers import Integral, Real
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import Field

from inkloop.component import Job, Port
from inkloop.contract import SIGNALS
from inkloop.files import installed_file
from inkloop.units import UNITS

_DTYPES = {"real": "float64", "integer": "int32", "boolean": "bool", "enumeration": "int64", "count": "uint64"}
_KINDS: Mapping[str, Any] = {"real": Real, "integer": Integral, "count": Integral, "boolean": bool | np.bool_}
"""Types of a value in Python."""

T = TypeVar("T")
_WRITTEN = {"m": "um", "s": "s", "1": ""}
"""Unit in a scenario of a variable by its own."""
Length = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=1)]
"""Limits that are reported with the key and the number of the scenario, not with those in SI further inside."""


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
        """NumPy's name of the type of a value in C."""
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

    @property
    def is_whole(self) -> bool:
        """Whether the values are whole numbers."""
        return self.type in ("integer", "count")

    def number(self, value: Any) -> Any:
        """A value of Python for C."""
        if value is None or (self.unlimited and value == inf):
            return self.start
        return self.items[value] if isinstance(value, str) else value

    def errors(self, value: Any, name: str = "") -> list[str]:
        """The error of a value of Python in SI, which may be called by another name."""
        if (value is None and self.default is None) or (self.unlimited and value == inf):
            return []
        if self.items:
            is_allowed, shown = isinstance(value, str) and value in self.items, repr(value)
        elif not isinstance(value, _KINDS[self.type]) or (self.is_whole and isinstance(value, bool)):
            is_allowed, shown = False, repr(value)
        else:
            most = min(self.max, np.iinfo(self.dtype).max) if self.is_whole else self.max
            is_allowed, shown = (self.least <= value <= most) and value != inf, f"{value}"
            is_allowed = is_allowed and not (self.is_above_least and value == self.least)
        return [] if is_allowed else [f"{name or self.name} is {shown}; needs {self.needs or self._range()}"]

    def port(self, shape: tuple[int, int]) -> Port:
        """An input or output on a grid of (nx, ny) cells; a signal of the layer contract as that states it."""
        if self.name in SIGNALS:
            return SIGNALS[self.name].port(shape)
        dtype = "int32" if self.items else self.dtype
        return Port(self.name, self.unit, shape if self.shape == "grid" else (), dtype, self.start)

    def _range(self) -> str:
        if self.items:
            *words, last = (f'"{word}"' for word in self.items)
            return f"{', '.join(words)} or {last}"
        if self.type == "boolean":
            return "True or False"
        if self.max == inf:
            return f"{'a whole number of ' if self.is_whole else ''}at least {self.least:g}"
        whole = "whole number" if self.is_whole else "value"
        return f"a {whole} of {self.least:g} to {self.max:g}"


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


@dataclass(frozen=True)
class Option:
    """Marks a keyword argument as an option: `Annotated[float, Option("um")]`; the class gives its default in SI.

    unit: of the number in a scenario, suffix of its key; "" for a pure number. meaning: for the page of the scenario
    file. absent: what the page gives as default if that is no value; form: type and limits in a scenario; None: as
    annotated.
    """

    unit: str = ""
    meaning: str = ""
    absent: str = "none"
    form: Any = None


def declared(name: str, form: Any = None) -> Option:
    """The option that variables.toml declares; a number with a unit has its lower limit in a scenario already."""
    found = options()[name]
    unit = _WRITTEN[found.unit]
    if unit and form is None:
        least = Field(gt=found.least) if found.is_above_least else Field(ge=found.least)
        form = Annotated[float, least, Field(allow_inf_nan=found.unlimited)]
        form = form | None if found.absent else form
    return Option(unit, found.scenario or found.description, found.absent or "none", form)


def default(name: str) -> Any:
    """The default of an option that variables.toml declares."""
    return options()[name].default


def errors_of(**given: Any) -> list[str]:
    """The errors of values by the names of variables.toml."""
    return [error for name, value in given.items() for error in options()[name].errors(value)]


def refuse(errors: list[str]) -> None:
    """Raises ValueError with all errors in one sentence, if there is one."""
    if errors:
        raise ValueError("; ".join(errors))


@dataclass(frozen=True)
class Keyword:
    """An option as a scenario writes it: an argument under its key, with the default in the unit of the key."""

    argument: str
    key: str
    annotation: Any
    default: Any
    option: Option

    def value(self, written: Any) -> Any:
        """The argument in SI."""
        return written * UNITS[self.option.unit][1] if self.option.unit else written


@cache
def keywords(part: Callable[..., object]) -> tuple[Keyword, ...]:
    """The options of a class, in the order of its arguments."""
    found = []
    hints = typing.get_type_hints(part.__init__ if inspect.isclass(part) else part, include_extras=True)
    for name, parameter in inspect.signature(part).parameters.items():
        annotation: Any = hints.get(name)
        option = next((mark for mark in getattr(annotation, "__metadata__", ()) if isinstance(mark, Option)), None)
        if option is None:
            continue
        annotation, default = option.form or annotation, parameter.default
        if isinstance(default, float) and isinf(default):
            annotation, default = annotation | None, None
        elif option.unit and default is not None:
            default /= UNITS[option.unit][1]
        found.append(Keyword(name, f"{name}_{option.unit}" if option.unit else name, annotation, default, option))
    return tuple(found)


def arguments(part: Callable[..., object], written: Mapping[str, Any]) -> dict[str, Any]:
    """The arguments of a class in SI that are among the options of a scenario."""
    given = {keyword: written.get(keyword.key) for keyword in keywords(part)}
    return {keyword.argument: keyword.value(value) for keyword, value in given.items() if value is not None}


def made_of(*parts: Callable[..., object]) -> Callable[[Callable[..., T]], Callable[..., T]]:
    """Gives `make(job, **options)` the options of these classes as its signature; other options are a TypeError."""

    def decorate(make: Callable[..., T]) -> Callable[..., T]:
        job = inspect.Parameter("job", inspect.Parameter.POSITIONAL_OR_KEYWORD, annotation=Job)
        keys = [
            inspect.Parameter(each.key, job.KEYWORD_ONLY, default=each.default, annotation=each.annotation)
            for part in parts
            for each in keywords(part)
        ]
        signature = inspect.Signature([job, *keys])

        @wraps(make)
        def checked(*given: object, **options: object) -> T:
            signature.bind(*given, **options)
            return make(*given, **options)

        vars(checked).update(__signature__=signature)
        checked.__annotations__ = {each.name: each.annotation for each in (job, *keys)}
        return checked

    return decorate
