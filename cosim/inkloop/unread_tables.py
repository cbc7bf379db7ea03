"""What can be told of components, connections and events of a file that is no scenario: other tables are faulty."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from inkloop import catalog
from inkloop.component import Job
from inkloop.connection_ends import Parts, component_of, end_faults, faultless
from inkloop.event_options import find_event_port

SIDE = 9
"""Cells along an edge of a grid whose own number is faulty."""


def component_faults(raw: Mapping[str, Any], folder: Path) -> list[str]:
    """Faults of options, of ends of connections and of ports of events, as far as they can be told.

    raw: the file as read; folder: where it stands.
    """
    parts = _parts(raw, folder)
    faults = [
        f"components.{name}.{fault}" for name, part in parts.items() for fault in catalog.faults(part[0], *part[1:])
    ]
    names = [str(name) for name in _table(raw, "components")]
    connections = [(source, target) for _, table in _rows(raw, "connections")
                   if isinstance(source := table.get("source"), str)
                   and isinstance(target := table.get("target"), str)]  # fmt: skip
    ports = [(number, table["port"]) for number, table in _rows(raw, "events") if isinstance(table.get("port"), str)]
    ends = [*(port for _, port in ports), *(end for both in connections for end in both)]
    with faultless(parts, {component_of(end) for end in ends}) as components:
        unmade = [name for name in names if name not in components]
        faults += end_faults(components, unmade, connections)
        for number, port in ports:
            faults += [f"events.[{number}].{fault}" for fault in find_event_port(port, components, unmade)[1]]
    return faults


def _parts(raw: Mapping[str, Any], folder: Path) -> Parts:
    nx, ny = (_cells(_table(raw, "grid").get(edge)) for edge in ("nx", "ny"))
    job = Job(nx, ny, pitch=1e-4, target_height=np.zeros((nx, ny)), mask=np.ones((nx, ny), dtype=np.bool_))
    parts = {}
    for name, table in _table(raw, "components").items():
        if isinstance(table, Mapping) and isinstance(kind := table.get("kind"), str):
            options = {key: value for key, value in table.items() if key != "kind"}
            parts[str(name)] = kind, job, catalog.beside(kind, options, folder)
    return parts


def _cells(found: object) -> int:
    return found if isinstance(found, int) and 1 <= found <= 1000 else SIDE


def _table(raw: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    found = raw.get(key)
    return found if isinstance(found, Mapping) else {}


def _rows(raw: Mapping[str, Any], key: str) -> Iterator[tuple[int, Mapping[str, Any]]]:
    """The tables of an array of tables, each with its number."""
    found = raw.get(key)
    for number, row in enumerate(found if isinstance(found, list) else []):
        if isinstance(row, Mapping):
            yield number, row
