"""From the `kind` in a scenario to a component: our FMUs by name, any FMU file, Python classes, third parties.

A Python class takes part as `Class(job, *, option: type = default, ...)`: its options are checked against these
annotations. It is named in the table below, by an entry point of the group "inkloop.components", or as
"package.module:Class". The options of an FMU are its parameters, with a unit in the key where they have one.
"""

from __future__ import annotations

import importlib
import inspect
import json
import typing
from collections.abc import Callable, Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError, create_model

from inkloop import fmu_options
from inkloop.component import Component, Job
from inkloop.errors import FmuError, ScenarioError
from inkloop.faults import nearest, sentence

GROUP = "inkloop.components"
FMU_MODELS = ("LayerDeposition", "ProfileSensor")
PYTHON_KINDS: Mapping[str, tuple[str, str]] = {
    "LayerMpc": ("inkloop_controller.component", "LayerMpcController"),
    "OpenLoop": ("inkloop_controller.component", "OpenLoopController"),
    "StochasticGreedy": ("inkloop_controller.component", "StochasticGreedyController"),
}


def make(kind: str, job: Job, options: Mapping[str, object]) -> Component:
    """The component of a kind, made for a job. Raises ScenarioError with everything wrong, FmuError."""
    if kind != "Fmu" and kind not in FMU_MODELS:
        component, found = _make_python(kind, job, options)
        if component is not None:
            return component
        raise ScenarioError(kind, found)
    found = faults(kind, job, options)
    if found:
        raise ScenarioError(kind, found)
    return fmu_options.make_from_file(job, options) if kind == "Fmu" else fmu_options.make_model(kind, job, options)


def faults(kind: str, job: Job, options: Mapping[str, object]) -> list[str]:
    """Everything wrong with the options of a kind, one sentence each, each beginning with the key; starts nothing."""
    if kind != "Fmu" and kind not in FMU_MODELS:
        return _make_python(kind, job, options)[1]
    try:
        if kind == "Fmu":
            return fmu_options.faults_of_file(job, options)
        return fmu_options.faults_of_model(kind, job, options)
    except FmuError as error:
        return [f"kind is {kind!r}: {error}"]


def _make_python(kind: str, job: Job, options: Mapping[str, object]) -> tuple[Component | None, list[str]]:
    """A Python component, or what is wrong; a ValueError of its constructor is a fault of the file."""
    try:
        factory = _load(kind)
        component: Component = factory(job, **_validated(factory, options))
    except ValidationError as error:
        return None, [sentence(detail, _options_table(factory)) for detail in error.errors()]
    except ValueError as error:
        return None, [str(error)]
    except LookupError:
        return None, [f"kind is {kind!r}; {nearest(kind, kinds())}"]
    except (ImportError, AttributeError) as error:
        return None, [f"kind is {kind!r}, which cannot be loaded: {error}"]
    except TypeError as error:
        return None, [f"kind is {kind!r}: its options are not what a scenario file can hold: {error}"]
    return component, []


def kinds() -> list[str]:
    """All kinds that can be named here and now, but for "package.module:Class"."""
    return sorted({*FMU_MODELS, "Fmu", *PYTHON_KINDS, *(point.name for point in entry_points(group=GROUP))})


def _load(kind: str) -> Callable[..., Any]:
    """The class of a kind. Raises LookupError if the kind is unknown, ImportError and AttributeError from loading."""
    if kind in PYTHON_KINDS:
        module, name = PYTHON_KINDS[kind]
        return typing.cast(Callable[..., Any], getattr(importlib.import_module(module), name))
    if ":" in kind:
        return typing.cast(Callable[..., Any], EntryPoint(kind, kind, GROUP).load())
    points = entry_points(group=GROUP, name=kind)
    if not points:
        raise LookupError(kind)
    return typing.cast(Callable[..., Any], next(iter(points)).load())


def _validated(factory: Callable[..., Any], options: Mapping[str, object]) -> dict[str, Any]:
    """Options with the types that the factory declares; TOML's arrays become what it asks for (a tuple, a set)."""
    table = _options_table(factory).model_validate_json(json.dumps(dict(options)))
    return {name: getattr(table, name) for name in table.model_fields_set}


def _options_table(factory: Callable[..., Any]) -> type[BaseModel]:
    """A table that describes the keyword-only options of a factory."""
    function = factory.__init__ if inspect.isclass(factory) else factory
    hints = typing.get_type_hints(function, include_extras=True)
    fields: dict[str, Any] = {
        parameter.name: (
            hints.get(parameter.name, Any),
            ... if parameter.default is parameter.empty else parameter.default,
        )
        for parameter in inspect.signature(factory).parameters.values()
        if parameter.kind is parameter.KEYWORD_ONLY
    }
    strict = ConfigDict(extra="forbid", strict=True)
    return create_model(getattr(factory, "__name__", "Options"), __config__=strict, **fields)
