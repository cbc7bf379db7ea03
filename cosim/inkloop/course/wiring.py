"""The wiring of a loop by the layer contract: every input from its namesake, and inputs that must not stay open."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from inkloop.component import HasPorts, is_shadow
from inkloop.contract import (
    CONTROLLER,
    HEIGHT,
    LAYERS_FOLLOWED,
    LAYERS_PRINTED,
    PRINTER,
    PROFILER,
    REQUIRED_INPUTS,
    SIGNALS,
)
from inkloop.master.wiring import Connection

EXAMPLES = {CONTROLLER: "LayerMpc", PRINTER: "LayerDeposition", PROFILER: "ProfileSensor"}
"""Role -> an example of its kinds."""


def contract_connections(components: Mapping[str, HasPorts]) -> list[Connection]:
    """Every input from the one other component that has an output of the same name, a shadow only if no other has it.

    An input with several such components is left open; `open_inputs` asks which one is meant. A component that scans a
    shadow takes the layers of the shadow, which may be a step behind the printer's.
    """
    wires = []
    for name, component in components.items():
        for port in component.inputs:
            sources = _sources(components, name, port.name)
            if len(sources) == 1:
                wires.append(Connection(sources[0], f"{name}.{port.name}"))
    return [_use_shadow_counter(wire, wires, components) for wire in wires]


def open_inputs(components: Mapping[str, HasPorts], connections: Sequence[Connection]) -> Iterator[str]:
    """A sentence for each input of the contract without a source, and for each input with several possible ones."""
    fed = {connection.target for connection in connections}
    for name, component in components.items():
        for port in component.inputs:
            place = f"{name}.{port.name}"
            if place in fed:
                continue
            sources = _sources(components, name, port.name)
            if len(sources) > 1:
                yield f"{place} may come from {' or '.join(sources)}; choose one under [[connections]]"
            elif port.name in REQUIRED_INPUTS.difference(getattr(component, "optional_inputs", ())):
                yield (
                    f"{place} is not connected: no other component has an output {port.name}; "
                    f"add {_giver_of(port.name)}, or name a source under [[connections]]"
                )


def _giver_of(signal: str) -> str:
    role = SIGNALS[signal].giver if signal in SIGNALS else None
    return f'a {role}, e.g. [components.{role}] with kind = "{EXAMPLES[role]}"' if role in EXAMPLES else "one that has"


def _use_shadow_counter(
    wire: Connection, wires: Sequence[Connection], components: Mapping[str, HasPorts]
) -> Connection:
    component, port = wire.target_parts
    if port != LAYERS_PRINTED:
        return wire
    surfaces = [other.source_parts[0] for other in wires if other.target_parts == (component, HEIGHT)]
    shadow = next((name for name in surfaces if is_shadow(components[name])), None)
    return wire if shadow is None else Connection(f"{shadow}.{LAYERS_FOLLOWED}", wire.target)


def _sources(components: Mapping[str, HasPorts], target: str, port: str) -> list[str]:
    having = [
        name
        for name, component in components.items()
        if name != target and any(output.name == port for output in component.outputs)
    ]
    real = [name for name in having if not is_shadow(components[name])]
    return [f"{name}.{port}" for name in real or having]
