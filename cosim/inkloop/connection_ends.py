"""Ends of connections that name nothing, told beside the faults of components that keep a loop from being made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from inkloop import catalog
from inkloop.component import Component, Job, Port
from inkloop.errors import FmuError, ScenarioError
from inkloop.wiring import find


def end_faults(
    parts: Mapping[str, tuple[str, Job, Mapping[str, Any]]], connections: Sequence[tuple[str, str]]
) -> list[str]:
    """What is wrong with (output, input), each "component.port"; an end at a component that cannot be made is left out.

    parts: kind, job and options of each component, some of them faulty.
    """
    named = {place.partition(".")[0] for ends in connections for place in ends}
    components = {name: _made(*parts[name]) for name in named if name in parts}
    faults: list[str] = []
    for ends in connections:
        for place, direction in zip(ends, ("output", "input"), strict=True):
            name = place.partition(".")[0]
            ports: dict[str, dict[str, Port]] = {
                other: {} for other in parts
            }  # so that a component of no such name is told by its neighbours
            if (component := components.get(name)) is not None:
                ports[name] = {port.name: port for port in getattr(component, f"{direction}s")}
            if component is not None or name not in parts:
                find(place, ports, direction, faults)
    for made in components.values():
        if made is not None:
            made.terminate()
    return faults


def _made(kind: str, job: Job, options: Mapping[str, Any]) -> Component | None:
    try:
        return catalog.make(kind, job, options)
    except (ScenarioError, FmuError):
        return None  # whose faults are told where components are checked
