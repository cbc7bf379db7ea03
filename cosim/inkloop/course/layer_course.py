"""The course of a print as the layer contract tells it: which layer is commanded, when the print ends, its events.

The components are known by their ports: the one that puts out `layer_command` commands, those with `layers_printed` and
`layers_scanned` count. The input `looked_at` of a controller that has ended the print for a reason is true in the
first step of a run that is resumed from there: a person has looked at it.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence

import numpy as np

from inkloop.component import HasPorts, Status, Values, is_shadow
from inkloop.contract import (
    CONTROLLER,
    COUNTERS,
    HEIGHT,
    LAYER_COMMAND,
    LAYERS_FOLLOWED,
    LAYERS_PRINTED,
    LAYERS_SCANNED,
    LOOKED_AT,
    PRINTER,
    PROFILER,
    REQUIRED_INPUTS,
    SIGNALS,
    STATUS,
    STOP_REASON,
    has_port,
)
from inkloop.course.events import Event, Manipulator
from inkloop.master.wiring import Connection

__all__ = ["LayerCourse"]

_FAULT, _DONE = int(Status.FAULT), int(Status.DONE)
Outputs = Mapping[str, Values]
"""Newest outputs by component."""


class LayerCourse:
    """The course of a print of these components, a `Course` of the master.

    layers_max: the print ends when so many layers are printed, and scanned if a component scans; events: changes to
    values between components; fed: inputs that are connected, each "component.port".

    Reasons of an end: "done": the component that commands layers reports it. "stopped": its `stop_reason` is above 0,
    as the scans do not show what was printed. "layers_max". "fault": a component's status is fault.
    """

    def __init__(
        self,
        components: Mapping[str, HasPorts],
        *,
        layers_max: int | None = None,
        events: Sequence[Event] = (),
        fed: Container[str] = (),
    ) -> None:
        self._layers_max = layers_max
        self._manipulator = Manipulator(events, components) if events else None
        givers = {count: _giver(components, count) for count in COUNTERS}
        self._counters = [(giver, count) for count in (LAYERS_PRINTED, LAYERS_SCANNED) if (giver := givers[count])]
        self._commander = givers[LAYER_COMMAND]
        can_be_told = self._commander and has_port(components[self._commander].inputs, LOOKED_AT)
        self._told = self._commander if can_be_told and f"{self._commander}.{LOOKED_AT}" not in fed else None
        self._is_looked_at = False

    @property
    def endless(self) -> str:
        """The reason why no layer ends the run, empty if one does."""
        if self._layers_max is not None and any(count == LAYERS_PRINTED for _, count in self._counters):
            return ""
        return "no component counts layers"

    def begin(self, outputs: Outputs) -> None:
        """The run starts with these outputs, or is resumed from them."""
        self._is_looked_at = self._told is not None and self._is_stopped(outputs)

    def inputs(self, name: str, values: Values, time_ns: int, outputs: Outputs) -> Values:
        """The inputs of a component in a step that begins at `time_ns`, after events."""
        if name == self._told:
            values = {**values, LOOKED_AT: np.asarray(self._is_looked_at)}
        if self._manipulator is None:
            return values
        return self._manipulator.inputs(name, values, time_ns, self._commanded(outputs))

    def outputs(self, name: str, values: Values, time_ns: int, outputs: Outputs) -> Values:
        """The outputs of a component after a step that began at `time_ns`, as the others see them."""
        if name == self._told:
            self._is_looked_at = False
        if self._manipulator is None:
            return values
        return self._manipulator.outputs(name, values, time_ns, self._commanded({**outputs, name: values}))

    def end(self, outputs: Outputs) -> str | None:
        """The reason why the run ends here, None if it does not."""
        if any(STATUS in values and int(values[STATUS]) == _FAULT for values in outputs.values()):
            return "fault"
        if self._commander is not None and int(outputs[self._commander].get(STATUS, 0)) == _DONE:
            return "done"
        if self._is_stopped(outputs) and not self._is_looked_at:
            return "stopped"
        counted = [int(outputs[name][count]) for name, count in self._counters]
        return "layers_max" if self._layers_max is not None and counted and min(counted) >= self._layers_max else None

    def place(self, outputs: Outputs) -> str:
        """Where the run is, for a message."""
        printed = [int(outputs[name][count]) for name, count in self._counters if count == LAYERS_PRINTED]
        return f"after layer {printed[0]}" if printed else ""

    def _commanded(self, outputs: Outputs) -> int:
        """Number of the last layer commanded, 0 if no component commands layers."""
        return int(outputs[self._commander][LAYER_COMMAND]) if self._commander is not None else 0

    def _is_stopped(self, outputs: Outputs) -> bool:
        """Whether the component that commands layers has ended the print."""
        return self._commander is not None and int(outputs[self._commander].get(STOP_REASON, 0)) > 0


def _giver(components: Mapping[str, HasPorts], output: str) -> str | None:
    """The first component that has an output of that name."""
    return next((name for name, component in components.items() if has_port(component.outputs, output)), None)


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
