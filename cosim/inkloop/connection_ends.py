"""Ends of connections that name nothing, told beside the faults of components that keep a loop from being made."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from inkloop import catalog
from inkloop.component import Component, Job, Port
from inkloop.errors import FmuError, ScenarioError
from inkloop.wiring import find

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
