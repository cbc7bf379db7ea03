"""An ink in a file of its own, which scenarios name: `[ink] file = "my-ink.toml"`. `inkloop identify` writes one.

Its values are put into the scenario when that is read, so that a run folder holds the ink as printed; keys of
the scenario itself have priority.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, MutableMapping
from pathlib import Path
from typing import Any

import tomlkit
from pydantic import Field, ValidationError
from tomlkit.items import Table as TomlTable

from inkloop.files import TomlError, read_toml_text, toml_tables
from inkloop.tables.messages import sentence
from inkloop.tables.shapes import Length, Table

__all__ = ["InkFile"]


class DropletTable(Table):
    """`[a]`, `[b]`: the height that one droplet adds."""

    h1_um: Length = Field(description="height added to the hit cell")
    h2_um: float = Field(ge=0.0, allow_inf_nan=False, description="height added to a side neighbour")
    h3_um: float = Field(ge=0.0, allow_inf_nan=False, description="height added to a corner neighbour")


class InkFile(Table):
    """The whole file. models: by kind the options of components; identified: origin of the numbers."""

    a: DropletTable
    b: DropletTable | None = None
    models: dict[str, dict[str, Any]] = Field(default={}, description="options of components, by kind")
    identified: dict[str, Any] = Field(default={}, description="for people")


def names_ink_file(tables: Mapping[str, Any]) -> bool:
    """Whether a scenario takes its inks from another file."""
    ink = tables.get("ink")
    return isinstance(ink, Mapping) and isinstance(ink.get("file"), str)


def merge_ink_file(document: tomlkit.TOMLDocument, folder: Path) -> list[str]:
    """Replace `ink.file` of a scenario by the content of that file; returns the errors, one sentence each."""
    if not names_ink_file(document):
        return []
    ink = document["ink"]
    name = str(ink.pop("file"))
    found, errors = _read(folder / name)
    if found is None:
        return [f"ink.file is {name!r}: {error}" for error in errors]
    for material in ("a", "b"):
        droplet: DropletTable | None = getattr(found, material)
        if droplet is not None:
            _fill(ink, material, droplet.model_dump())
    for table in _component_tables(document):
        for key, value in found.models.get(str(table.get("kind")), {}).items():
            table.setdefault(key, value)
    if isinstance(ink, TomlTable):
        ink.comment(f"from {name}")
    return []


def _read(path: Path) -> tuple[InkFile | None, list[str]]:
    try:
        raw = toml_tables(read_toml_text(path))
        return InkFile.model_validate(raw), []
    except OSError as error:
        return None, [f"{path} cannot be read: {error.strerror}; name an ink file, relative to the scenario"]
    except TomlError as error:
        return None, [str(error)]
    except ValidationError as error:
        return None, [sentence(detail, InkFile) for detail in error.errors()]


def _fill(ink: MutableMapping[str, Any], material: str, values: dict[str, float]) -> None:
    """Fill in the keys of a material that the scenario leaves out."""
    own = ink.get(material)
    if own is None:
        ink[material] = values
    elif isinstance(own, MutableMapping):  # any other type is an error reported by the schema
        for key, value in values.items():
            own.setdefault(key, value)


def _component_tables(document: tomlkit.TOMLDocument) -> Iterator[MutableMapping[str, Any]]:
    """All tables of components, those of comparison runs included."""
    places = [document]
    compare = document.get("compare")
    if isinstance(compare, MutableMapping):
        places += list(compare.values())
    for place in places:
        components = place.get("components") if isinstance(place, MutableMapping) else None
        if isinstance(components, MutableMapping):
            yield from (table for table in components.values() if isinstance(table, MutableMapping))
