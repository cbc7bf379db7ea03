"""Ends of connections that name nothing, told beside the faults of components that keep a loop from being made."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from inkloop.component import Component, Job, Port, is_device, is_shadow
from inkloop.components import catalog
from inkloop.contract import HEIGHT, LAYERS_PRINTED, LAYERS_SCANNED, has_port
from inkloop.errors import FmuError, ScenarioError
from inkloop.master.wiring import Connection, find
from inkloop.scenario.events import find_event_port

Parts = Mapping[str, tuple[str, Job, Mapping[str, Any]]]
"""By component its kind, job and options, some of them faulty."""


@contextmanager
def faultless(parts: Parts, names: Collection[str]) -> Iterator[dict[str, Component]]:
    """The components of these names that can be made, terminated at the end."""
    components = {name: made for name in names if name in parts and (made := _made(*parts[name])) is not None}
    try:
        yield components
    finally:
        for component in components.values():
            component.terminate()


def component_of(place: str) -> str:
    """Name of the component in "component.port"."""
    return place.partition(".")[0]


def end_faults(
    components: Mapping[str, Component], unmade: Collection[str], connections: Sequence[tuple[str, str]]
) -> list[str]:
    """What is wrong with (output, input), each "component.port"; ends at components that are not made are left out."""
    faults: list[str] = []
    for ends in connections:
        for place, direction in zip(ends, ("output", "input"), strict=True):
            ports: dict[str, dict[str, Port]] = {name: {} for name in unmade}
            ports |= {
                name: {port.name: port for port in getattr(component, f"{direction}s")}
                for name, component in components.items()
            }
            if component_of(place) not in unmade:
                find(place, ports, direction, faults)
    return faults


def _made(kind: str, job: Job, options: Mapping[str, Any]) -> Component | None:
    try:
        return catalog.make(kind, job, options)
    except (ScenarioError, FmuError):
        return None  # whose faults are told where components are checked


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


def mix_faults(components: Mapping[str, Component]) -> list[str]:
    """What is wrong with devices beside simulated parts, one sentence each; empty if they go together.

    A device that prints needs a device that scans and the other way round, or a shadow: a model that follows the
    commanded patterns.
    """
    if any(is_shadow(component) for component in components.values()):
        return []
    advice = 'add a component with kind = "Shadow", a model that follows the commanded patterns'
    faults = []
    for printer in _giving(LAYERS_PRINTED, components):
        for profiler in _giving(LAYERS_SCANNED, components):
            if is_device(components[printer]) and not is_device(components[profiler]):
                faults.append(
                    f"{printer} is a device and {profiler} simulates a sensor, which has no surface to scan; {advice} "
                    f"and gives {profiler} its height, or make {profiler} a device"
                )
            elif is_device(components[profiler]) and not is_device(components[printer]):
                faults.append(
                    f"{profiler} is a device and {printer} simulates a printer, of which {profiler} sees nothing; "
                    f"{advice}, to be held against the scans, or make {printer} a device"
                )
    return faults


def shadow_faults(components: Mapping[str, Component], connections: Sequence[Connection]) -> list[str]:
    """A shadow that a sensor scans must not take those scans for the surface that it begins on."""
    faults = []
    fed = {connection.target_parts: connection.source_parts for connection in connections}
    for name, component in components.items():
        sensor, _ = fed.get((name, LAYERS_SCANNED), ("", ""))
        scans_shadow = fed.get((sensor, HEIGHT)) == (name, HEIGHT)
        if is_shadow(component) and scans_shadow and getattr(component, "start", "job") != "job":
            faults.append(
                f'{name} begins on the first scan of {sensor}, which scans {name} itself; write start = "job" in '
                f"components.{name}, or let {sensor} scan a printer"
            )
    return faults


def _giving(output: str, components: Mapping[str, Component]) -> Iterable[str]:
    return [name for name, part in components.items() if has_port(part.outputs, output)]
