"""Override values of a scenario file, by dotted key or by nested tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from tomlkit.items import Item

from inkloop.suggest import nearest


def apply_overrides(document: tomlkit.TOMLDocument, overrides: Mapping[str, Any]) -> list[str]:
    """Set values in the document by dotted or nested keys; a sentence for each that cannot be set."""
    if not isinstance(overrides, Mapping):
        raise TypeError(f"overrides are {overrides!r}; expected a mapping, e.g. {{'components.controller.alpha': 0.5}}")
    return [error for path, value in _leaves(overrides) if (error := _apply(document, path, value))]


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
