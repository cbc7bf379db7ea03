"""The options of a Python class in a scenario: the keyword-only parameters that it declares, as a table."""

from __future__ import annotations

import inspect
import json
import typing
from collections.abc import Callable, Mapping
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError, create_model

from inkloop.suggest import near


def validated(factory: Callable[..., Any], options: Mapping[str, object]) -> dict[str, Any]:
    """Options with the types that the factory declares; TOML's arrays become what it asks for (a tuple, a set)."""
    table = options_table(factory).model_validate_json(json.dumps(dict(options)))
    return {name: getattr(table, name) for name in table.model_fields_set}


def options_table(factory: Callable[..., Any]) -> type[BaseModel]:
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


def as_meant(table: type[BaseModel], options: Mapping[str, object], error: ValidationError) -> dict[str, object] | None:
    """The options without those that `error` names, a misspelt key as the one it is nearest to, so that the others
    can be judged; None where a required option is wrong: nothing can be judged without it.
    """
    wrong = {str(detail["loc"][0]): detail["type"] for detail in error.errors()}
    left = {key: value for key, value in options.items() if key not in wrong}
    for key in (key for key, fault in wrong.items() if fault == "extra_forbidden"):
        meant = near(key, table.model_fields)
        if len(meant) == 1 and meant[0] not in options:
            left[meant[0]] = options[key]
    is_whole = all(name in left for name, field in table.model_fields.items() if field.is_required())
    return left if is_whole else None
