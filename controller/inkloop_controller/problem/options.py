"""Options of a controller in a scenario: keyword arguments of the classes that it is made of, marked where they stand.

A scenario writes an argument with a unit in the unit of its key: `overshoot_limit` [m] as `overshoot_limit_um`, and
leaves out what is infinite or None.
"""

from __future__ import annotations

import inspect
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, wraps
from math import isinf
from typing import Annotated, Any, TypeVar

from pydantic import Field

from inkloop.component import Job
from inkloop.units import UNITS
from inkloop_controller.problem.variables import options

T = TypeVar("T")
_WRITTEN = {"m": "um", "s": "s", "1": ""}
"""Unit in a scenario of a variable by its own."""
Length = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=1)]
"""Limits that are reported with the key and the number of the scenario, not with those in SI further inside."""


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
