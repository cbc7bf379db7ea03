"""The scenario file as a JSON Schema (draft 7), for editors that complete and check TOML while it is written.

It is made from the tables of `inkloop.tables.schema` and the options of the kinds of component that are installed.
Errors that only a whole file can show (a part beyond its grid, a missing port) are left to `inkloop validate`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from inkloop.components import catalog, devices
from inkloop.components.fmu_parameters import FORMS, PRESETS
from inkloop.fmu import Variable, describe
from inkloop.fmu_writer.export import find_fmu
from inkloop.tables.schema import ScenarioFile
from inkloop.units import key_of

Schema = dict[str, Any]
JSON_TYPES = {"f": "number", "b": "boolean", "i": "integer", "u": "integer"}


def scenario_schema() -> Schema:
    """The whole schema. Raises FmuError where one of our FMUs is missing."""
    schema = ScenarioFile.model_json_schema()
    definitions = schema["$defs"]
    options = {model: _model_options(model) for model in catalog.FMU_MODELS}
    options |= {kind: _model_options(device.model) for kind, device in devices.KINDS.items()}
    for kind, python in catalog.PYTHON_KINDS.items():
        table = python.options_table().model_json_schema()
        definitions.update(table.pop("$defs", {}))
        options[kind] = table
    definitions["ComponentTable"] = _by_kind(definitions["ComponentTable"], options)
    return {"$schema": "http://json-schema.org/draft-07/schema#", **schema, "title": "inkloop scenario"}


def keys_of(raw: Mapping[str, Any]) -> list[str]:
    """The keys that `--set` may give to a scenario, dotted: those of all tables, and of its own components.

    raw: the file as read, whose errors do not matter. Raises FmuError where one of our FMUs is missing.
    """
    schema = scenario_schema()
    definitions = schema["$defs"]
    rules = definitions["ComponentTable"]["allOf"]
    options = {rule["if"]["properties"]["kind"]["const"]: rule["then"]["properties"] for rule in rules}
    found = list(_keys(schema, definitions))
    components = raw.get("components")
    for name, table in components.items() if isinstance(components, Mapping) else ():
        kind = table.get("kind") if isinstance(table, Mapping) else None
        own = {**options.get(kind, {}), "kind": {}}
        found += _keys({"properties": own}, definitions, f"components.{name}.")
    return list(dict.fromkeys(found))


def _keys(table: Schema, definitions: Mapping[str, Schema], above: str = "") -> Iterator[str]:
    """Dotted keys of a table and of those in it; of one that has a choice of tables, those of all."""
    for each in (table, *table.get("anyOf", ()), *table.get("oneOf", ())):
        if "$ref" in each:
            yield from _keys(definitions[each["$ref"].rpartition("/")[2]], definitions, above)
        for name, value in each.get("properties", {}).items():
            if value.get("type") == "object":  # of tables by their names
                continue
            yield from list(_keys(value, definitions, f"{above}{name}.")) or [f"{above}{name}"]


def _by_kind(table: Schema, options: dict[str, Schema]) -> Schema:
    """The table of a component: its keys depend on its kind; those of a foreign kind are unknown."""
    kind = {
        "anyOf": [{"enum": catalog.kinds()}, {"type": "string", "pattern": ":"}],
        "description": "one of the catalog, or package.module:Class",
    }
    rules = [
        {
            "if": {"properties": {"kind": {"const": name}}},
            "then": {
                "properties": {"kind": True, **known["properties"]},
                "required": known.get("required", []),
                "additionalProperties": False,
            },
        }
        for name, known in options.items()
    ]
    return {**table, "properties": {"kind": kind}, "required": ["kind"], "additionalProperties": True, "allOf": rules}


def _model_options(model: str) -> Schema:
    """Options of one of our FMUs: its parameters, the form, and the preset."""
    properties: Schema = {"fmi": {"enum": list(FORMS), "description": "form of the FMU"}}
    if model in PRESETS:
        properties["preset"] = {"enum": list(PRESETS[model]), "description": "instrument; other keys win over it"}
    for variable in describe(find_fmu(model, FORMS[0])).parameters.values():
        key = key_of(variable.name, variable.unit)
        properties[key.text] = _variable(variable, key.factor)
    return {"properties": properties}


def _variable(variable: Variable, factor: float) -> Schema:
    """One value, or nested lists of them where the variable is an array; limits in the unit of the key."""
    if variable.items:
        value: Schema = {"enum": [*variable.items, *variable.items.values()]}
    else:
        value = {"type": JSON_TYPES[np.dtype(variable.dtype).kind]}
        limits = {"minimum": variable.minimum, "maximum": variable.maximum}
        value |= {word: float(limit) / factor for word, limit in limits.items() if limit is not None}
    nested = value
    for _ in variable.dimensions:
        nested = {"type": "array", "items": nested}
    either = {"anyOf": [value, nested]} if variable.dimensions else value
    return {"description": variable.description, **either}
