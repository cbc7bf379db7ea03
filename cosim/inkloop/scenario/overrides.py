"""Override values of a scenario file, by dotted key or by nested tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from tomlkit.items import Item

from inkloop.errors import nearest

UNPRINTED = ("title", "label", "literature", "metrology", "bench")
"""Keys and tables that change nothing of what is printed."""
NOTED_MAX, NOTED_WIDTH = 3, 30
"""Overrides that a title names, and characters of a value that it shows."""


def apply_overrides(document: tomlkit.TOMLDocument, overrides: Mapping[str, Any]) -> list[str]:
    """Set values in the document by dotted or nested keys; a sentence for each that cannot be set.

    The title names the new values. Of another print than the file describes, published figures are left out; another
    seed is the same print.
    """
    if not isinstance(overrides, Mapping):
        raise TypeError(f"overrides are {overrides!r}; expected a mapping, e.g. {{'components.controller.alpha': 0.5}}")
    leaves = [(".".join(key.strip() for key in path.split(".")), value) for path, value in _leaves(overrides)]
    errors = [error for path, value in leaves if (error := _apply(document, path, value))]
    given = {path.partition(".")[0] for path, _ in leaves}
    noted = [_noted(path, value) for path, value in leaves if path.partition(".")[0] not in UNPRINTED]
    if noted and "title" not in given and isinstance(document.get("title"), str):
        more = [f"{len(noted) - NOTED_MAX} more"] if len(noted) > NOTED_MAX else []
        document["title"] = f"{document['title']} ({', '.join(noted[:NOTED_MAX] + more)})"
    if given.difference(UNPRINTED, ["seed"]) and "literature" not in given:
        document.pop("literature", None)
    return errors


def _noted(path: str, value: Any) -> str:
    """An override in a title."""
    text = "..." if isinstance(value, Mapping) else str(_plain(value))
    shown = text if len(text) <= NOTED_WIDTH else f"{text[:NOTED_WIDTH]}..."
    return f"{path.removeprefix('components.')} = {shown}"


def _leaves(overrides: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted key and value of all that is not a table; an inline table of TOML and an empty one replace the whole."""
    for key, value in overrides.items():
        if isinstance(value, Mapping) and value and not isinstance(value, Item):
            yield from _leaves(value, f"{path}{key}.")
        else:
            yield f"{path}{key}", value


def _apply(document: tomlkit.TOMLDocument, path: str, value: Any) -> str | None:
    keys = [key.strip() for key in path.split(".")]
    components = document.get("components", {})
    if keys[0] == "components" and len(keys) > 2 and keys[1] not in components and keys[2:] != ["kind"]:
        known = [f"components.{name}" for name in components]
        return f"{path}: there is no components.{keys[1]}; {nearest(f'components.{keys[1]}', known)}"
    if len(keys) > 1 and keys[0] in components and keys[0] not in document:
        return f"{path}: there is no table {keys[0]}; did you mean components.{path}?"
    table: Any = document
    for key in keys[:-1]:
        if key not in table:
            table[key] = tomlkit.table()
        table = table[key]
        if not isinstance(table, Mapping):
            return f"{path}: {key} is not a table"
    try:
        table[keys[-1]] = _plain(value)
    except ValueError:  # of tomlkit
        return f"{path} is {value!r}; expected a number, a string, true or false, a list or a table"
    return None


def _plain(value: Any) -> Any:
    """A value as TOML can hold it: NumPy's numbers and arrays as Python's, a path as a string."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping) and not isinstance(value, Item):
        return dict(value)
    return str(value) if isinstance(value, Path) else value
