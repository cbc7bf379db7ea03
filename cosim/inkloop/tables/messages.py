"""Errors of a scenario file as sentences: place, what was found, what is expected; keys that carry their unit."""

from __future__ import annotations

import re
import types
import typing
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from inkloop.errors import nearest
from inkloop.units import QUANTITIES, conversion, key_of, parts_of, si_unit

__all__ = ["sentence"]

_PLAIN = {
    "a valid integer": "a whole number",
    "a valid number": "a number",
    "a valid boolean": "true or false",
    "a valid string": "a text in quotes",
    "a valid list": "a list, [..., ...]",
}
"""Name of a type in pydantic -> its name in messages about files."""
_NUMBER = re.compile(r"['\"]\s*[+-]?[0-9.]")


def sentence(detail: ErrorDetails, root: type[BaseModel]) -> str:
    """One error of the file whose tables `root` describes."""
    path, table, field, kind = _locate(detail["loc"], root)
    place = ".".join(path) or "it"
    if detail["type"] == "missing":
        return f"{place} is missing; add it{_meaning(field)}"
    if detail["type"] == "extra_forbidden":
        if reason := other_unit(path[-1], detail["input"], _keys(table)):
            return ".".join([*path[:-1], reason])
        return f"{place} is not a key of this table; {nearest(path[-1], _keys(table))}"
    if detail["type"] in ("union_tag_invalid", "union_tag_not_found"):
        choices = ", ".join(_tags(kind))
        found = f"is {detail['ctx']['tag']!r}" if "tag" in detail.get("ctx", {}) else "is missing"
        is_file = "." in str(detail.get("ctx", {}).get("tag", ""))
        advice = '; a file is printed with shape = "mesh", "stack" or "height-map" and file = "..."' if is_file else ""
        return f"{place}.shape {found}; expected one of {choices}{advice}"
    expected = detail["msg"].replace("Input should be", "expected", 1).replace("Value error, ", "", 1)
    for theirs, ours in _PLAIN.items():
        expected = expected.replace(theirs, ours)
    if detail["type"] in ("model_type", "model_attributes_type", "dict_type"):
        expected = f"expected a table{_header(path)}"
    if detail["type"] in ("float_type", "int_type") and _NUMBER.match(repr(detail["input"])):
        expected += ", without quotes and without a unit"
    return f"{place} is {_show(detail['input'])}; {expected}{_meaning(field)}"


def _locate(
    loc: tuple[int | str, ...], root: type[BaseModel]
) -> tuple[list[str], type[BaseModel] | None, FieldInfo | None, Any]:
    """Path of an error in the file, the table it stands in, the field and its type, as far as they are known."""
    path: list[str] = []
    table: type[BaseModel] | None = root
    field: FieldInfo | None = None
    kind: Any = root
    for key in loc:
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            table, field = kind, kind.model_fields.get(str(key))
            kind = field and _kind_of(field)
        elif isinstance(key, str) and (chosen := _tags(kind).get(key)):
            table = kind = chosen
            continue  # the tag of a union is no key of the file
        else:
            kind = next(iter(typing.get_args(kind)[-1:]), None)
        kind = _without_none(kind)
        path.append(str(key) if isinstance(key, str) else f"[{key}]")
    return path, table, field, kind


def _header(path: list[str]) -> str:
    """Header of the table in a file of tables; nothing for the whole file."""
    if not path:
        return ""
    return f", [[{path[-2]}]]" if path[-1].startswith("[") else f", [{'.'.join(path)}]"


def _kind_of(field: FieldInfo) -> Any:
    """The type of a field; of a discriminated union with the discriminator, as a type in a list has it."""
    return typing.Annotated[field.annotation, field] if field.discriminator else field.annotation


def _tags(kind: Any) -> Mapping[str, type[BaseModel]]:
    """Tag -> table of a discriminated union; empty for any other type."""
    union, *marks = typing.get_args(kind) if typing.get_origin(kind) is typing.Annotated else (None,)
    key = next((mark.discriminator for mark in marks if isinstance(mark, FieldInfo)), None)
    tables = typing.get_args(union) if isinstance(key, str) else ()
    return {typing.get_args(table.model_fields[key].annotation)[0]: table for table in tables}


def _keys(table: type[BaseModel] | None) -> list[str]:
    return [field.alias or name for name, field in table.model_fields.items()] if table else []


def _without_none(kind: Any) -> Any:
    if isinstance(kind, types.UnionType) and type(None) in typing.get_args(kind):
        return next(option for option in typing.get_args(kind) if option is not type(None))
    return kind


def _meaning(field: FieldInfo | None) -> str:
    return f" ({field.description})" if field and field.description else ""


def _show(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def read_quantities(
    found: Mapping[str, object], units: Mapping[str, str], other_keys: Iterable[str] = ()
) -> tuple[dict[str, tuple[str, object]], list[str]]:
    """By quantity of a table its key and the value in `units` (quantity -> unit); and the errors of the keys.

    A value is a number, a boolean or a nested list of them; `other_keys` are further keys of the table.
    """
    keys = {key_of(name, unit).text: name for name, unit in units.items()}
    errors = [
        other_unit(key, value, keys) or f"{key} is not a key of this table; {nearest(key, (*keys, *other_keys))}"
        for key, value in found.items()
        if key not in keys
    ]
    values = {
        name: (key, scaled(found[key], key_of(name, units[name]).factor)) for key, name in keys.items() if key in found
    }
    return values, errors


def other_unit(key: str, value: object, known: Iterable[str]) -> str | None:
    """The error in a key that gives one of the `known` ones in another unit or in none; None for any other key."""
    name, unit = parts_of(key)
    for right in known:
        own, to_unit = parts_of(right)
        if to_unit and own == key:
            return f"{key} is {QUANTITIES[si_unit(to_unit)[0]]}; write {right}"
        if unit and to_unit and own == name and (factor := conversion(unit, to_unit)) is not None:
            found = scaled(value, factor)
            return f"{key} is in {unit}; write {right}" + ("" if found is value else f" = {_shown(found)}")
    return None


def scaled(value: object, factor: float) -> object:
    """A number or nested list of numbers times `factor`; anything else as it is, to be rejected by the reader."""
    if factor == 1.0:
        return value
    try:
        array = np.asarray(value)
    except ValueError:
        return value
    if array.dtype.kind not in "iuf":
        return value
    return (array * factor).item() if array.ndim == 0 else array * factor


def _shown(value: object) -> str:
    """Numbers without the last digits, which a conversion may have changed."""
    return np.array2string(np.asarray(value), separator=", ", threshold=6, formatter={"float": "{:.12g}".format})
