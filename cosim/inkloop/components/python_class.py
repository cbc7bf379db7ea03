"""Kinds that are Python classes: `Class(job, option: type = default, ...)`.

Options are checked against these types. A class is a component, or has a method `pattern` and becomes a controller
that goes by it, or is what an adapter makes a component of, as `adapter(kind, job, object)`. A method `use_rig(rig)` is
given the bus of `[bench]` before the loop is initialized, `use_journal(journal)` the journal of the run.
"""

from __future__ import annotations

import copy
import inspect
import json
import types
import typing
import weakref
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError, create_model

from inkloop.component import MEMBERS, Component, Job, Ports
from inkloop.component_errors import repeated
from inkloop.components.kind import Bench, Checked, load
from inkloop.errors import ScenarioError, message_of, near, nearest, own_line
from inkloop.tables.messages import sentence

ADAPTERS = "inkloop.adapters"
"""Group of entry points whose functions make components of objects that are none."""
_RULE_CONTROLLER = ("inkloop_controller.controllers", "rule_controller")


@dataclass(frozen=True)
class PythonClass:
    """A kind that a Python class makes; it is imported when options are checked.

    entry: kind and "module:Class"; adapter: makes the component of an object of the class, which is none.
    """

    entry: EntryPoint
    path_option: str | None = None
    adapter: EntryPoint | None = None

    def options_table(self) -> type[BaseModel]:
        """The options as a table. Raises ImportError and AttributeError if the class cannot be loaded."""
        return options_table(self._load())

    def check(self, job: Job, options: Mapping[str, object]) -> Checked:
        """Check options against the types of the class, then by its constructor, whose ValueError is an error of them.

        The component that this needs is the first one to be made.
        """
        kind = self.entry.name
        try:
            return self._constructed(job, options)
        except ValidationError as error:
            table = self.options_table()
            errors = [sentence(detail, table) for detail in error.errors()]
            left = without_invalid_keys(table, options, error)
            return Checked(kind, errors if left is None else [*errors, *self.check(job, left).errors])
        except ScenarioError as error:  # errors of a file that an option names
            key = next((key for key, value in options.items() if value == error.source), "kind")
            return Checked(kind, [f"{key}: {Path(error.source).name}: {message}" for message in error.errors])
        except ValueError as error:
            return Checked(kind, [str(error)])
        except (ImportError, AttributeError) as error:
            return Checked(
                kind, [f"kind is {kind!r}, which cannot be loaded: {error}{own_line(error)}{_advice(error)}"]
            )
        except (Exception, SystemExit) as error:  # anything may go wrong in a class of others
            if isinstance(error, TypeError) and not own_line(error):
                takes = "a class takes the job, then options by keyword with types of TOML"
                return Checked(kind, [f"kind is {kind!r}, which cannot be constructed: {error}; {takes}"])
            return Checked(kind, [f"kind is {kind!r}, which cannot be constructed: {message_of(error)}"])

    def _constructed(self, job: Job, options: Mapping[str, object]) -> Checked:
        """Valid options with the component that they make. Raises the errors of loading and of the constructor."""
        factory = self._load()
        table = options_table(factory).model_validate_json(json.dumps(dict(options)))
        chosen = {name: getattr(table, name) for name in table.model_fields_set}

        def construct() -> _Made:
            made = factory(job, **copy.deepcopy(chosen))
            return _Made(self._component(job, made), made)

        first = construct()
        constructed, ports = _Constructed(first, construct), Ports.of(first.component)
        for kind, own in (("inputs", ports.inputs), ("outputs", ports.outputs)):
            if twice := repeated(port.name for port in own):
                raise ValueError(f"{kind}: two are called {' and '.join(map(repr, twice))}; needs a name for each")
        return Checked(self.entry.name, ports=ports, construct=constructed)

    def _component(self, job: Job, made: Any) -> Component:
        """An object of the class as a component. Raises ValueError where it cannot become one."""
        if self.adapter is not None:
            return typing.cast(Component, self.adapter.load()(self.entry.name, job, made))
        if isinstance(made, Component):
            return made
        if callable(getattr(made, "pattern", None)):
            return typing.cast(Component, load(*_RULE_CONTROLLER)(job, made))
        missing = [name for name in MEMBERS if not hasattr(made, name)]
        adapted = [f"{adapter.name}:{self.entry.value}" for adapter in entry_points(group=ADAPTERS)]
        raise ValueError(
            f"kind is {self.entry.name!r}, which has no {', '.join(missing)}; needs those, or a method pattern, "
            f"or an adapter: {' or '.join(adapted)}"
        )

    def _load(self) -> Callable[..., Any]:
        return typing.cast(Callable[..., Any], self.entry.load())


@dataclass(frozen=True)
class _Made:
    """A component, and the instance of the class, which may take rig and journal of its loop."""

    component: Component
    instance: Any


class _Constructed:
    """Hands over a component that is constructed already, then constructs further ones.

    One that is never handed over is terminated when this is dropped.
    """

    def __init__(self, first: _Made, construct: Callable[[], _Made]) -> None:
        self._first: _Made | None = first
        self._construct = construct
        self._terminate = weakref.finalize(self, first.component.terminate)

    def __call__(self, bench: Bench, name: str) -> Component:
        """The component at the first call, a new one at every other; it has the rig of the bench."""
        made, self._first = self._first or self._construct(), None
        self._terminate.detach()
        if hasattr(made.instance, "use_rig"):
            made.instance.use_rig(bench.rig)
        if hasattr(made.instance, "use_journal"):
            made.instance.use_journal(bench.journal)
        return made.component


@lru_cache(maxsize=32)
def options_table(factory: Callable[..., Any]) -> type[BaseModel]:
    """The options of a factory as a table: its arguments behind the job, with their types.

    Read from JSON, arrays of TOML become the declared type (a tuple, a set).
    """
    function = factory.__init__ if inspect.isclass(factory) else factory
    hints = typing.get_type_hints(function, include_extras=True)
    fields: dict[str, Any] = {
        parameter.name: (
            hints.get(parameter.name, Any),
            ... if parameter.default is parameter.empty else parameter.default,
        )
        for place, parameter in enumerate(inspect.signature(factory).parameters.values())
        if parameter.kind is parameter.KEYWORD_ONLY or (place and parameter.kind is parameter.POSITIONAL_OR_KEYWORD)
    }
    strict = ConfigDict(extra="forbid", strict=True, arbitrary_types_allowed=True)
    return create_model(getattr(factory, "__name__", "Options"), __config__=strict, **fields)


def without_invalid_keys(
    table: type[BaseModel], options: Mapping[str, object], error: ValidationError
) -> dict[str, object] | None:
    """The options without those that `error` names, a misspelt key renamed to the nearest one, to check the others.

    None where a required option is invalid: nothing can be checked without it.
    """
    wrong = {str(detail["loc"][0]): detail["type"] for detail in error.errors()}
    left = {key: value for key, value in options.items() if key not in wrong}
    for key in (key for key, kind in wrong.items() if kind == "extra_forbidden"):
        meant = near(key, table.model_fields)
        if len(meant) == 1 and meant[0] not in options:
            left[meant[0]] = options[key]
    is_whole = all(name in left for name, field in table.model_fields.items() if field.is_required())
    return left if is_whole else None


def _advice(error: ImportError | AttributeError) -> str:
    """Folders searched for a missing module, or the classes of a module that lacks the named one."""
    if isinstance(error, ModuleNotFoundError):
        return f"; looked for modules in {Path.cwd()}, next to the scenario, and in the installed packages"
    if isinstance(error, AttributeError) and isinstance(error.obj, types.ModuleType):
        classes = [name for name, found in vars(error.obj).items() if _is_own_class(found, error.obj)]
        name = str(error.name)
        return f"; {nearest(name, classes)}" if classes else "; it defines no class"
    return ""


def _is_own_class(found: object, module: types.ModuleType) -> bool:
    return isinstance(found, type) and found.__module__ == module.__name__
