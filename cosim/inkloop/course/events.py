"""Events of a scenario: change inputs or outputs of a component from a layer or a time on, unseen by it.

The terms are those of libcosim: an override replaces a value, a bias adds to it, a reset cancels the events above it in
the file. Where events meet on a port, they act in the order of the file. The events in effect depend on the layer and
the time alone, so that a resumed run needs no history.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap, HasPorts, Port, Values
from inkloop.units import S_PER_NS

Action = Literal["override", "bias", "reset"]


@dataclass(frozen=True, eq=False)
class Event:
    """A change to the port at `place` ("component.port"), in the port's unit and type.

    It begins with the layer that is commanded as `at_layer`, or with the first step that begins at `at_time_ns` or
    later; one of the two is None. value: a scalar or an array of the port's shape, None for a reset; per_layer: added
    for each further layer; cells: those changed, None: all.
    """

    place: str
    action: Action
    at_layer: int | None = None
    at_time_ns: int | None = None
    value: NDArray[Any] | None = None
    per_layer: NDArray[Any] | None = None
    cells: BoolMap | None = None

    def has_begun(self, time_ns: int, layer: int) -> bool:
        """Whether it is in effect in a step that begins at `time_ns` while `layer` is the last one commanded."""
        if self.at_layer is not None:
            return layer >= self.at_layer
        return self.at_time_ns is not None and time_ns >= self.at_time_ns

    def applied(self, value: NDArray[Any], original: NDArray[Any], layer: int) -> NDArray[Any]:
        """The changed `value`, which was `original` before all events."""
        if self.action == "reset" or self.value is None:
            changed = original
        else:
            change = self.value
            if self.per_layer is not None and self.at_layer is not None:
                change = change + self.per_layer * (layer - self.at_layer)
            changed = value + change if self.action == "bias" else np.broadcast_to(change, value.shape)
        if self.cells is not None:
            changed = np.where(self.cells, changed, value)
        return np.asarray(changed, dtype=original.dtype)

    def __str__(self) -> str:
        when = (
            f"layer {self.at_layer}" if self.at_layer is not None else f"t = {(self.at_time_ns or 0) * S_PER_NS:.9g} s"
        )
        what = "" if self.value is None else f" {_range(self.value)}"
        growth = "" if self.per_layer is None else f", {_range(self.per_layer)} more with each further layer"
        where = "" if self.cells is None else f" in {int(self.cells.sum())} cells"
        return f"from {when}: {self.action} {self.place}{what}{growth}{where}"


class Manipulator:
    """Applies events to the values of a running loop. `components` must have the ports that `events` name.

    A change of an output is seen by all components and the record; one of an input by its component alone.
    """

    def __init__(self, events: Sequence[Event], components: Mapping[str, HasPorts]) -> None:
        self._inputs: dict[str, dict[str, _ChangedPort]] = {}
        self._outputs: dict[str, dict[str, _ChangedPort]] = {}
        for place in dict.fromkeys(event.place for event in events):
            component, _, name = place.partition(".")
            port, is_input = find_port(components[component], name)
            side = self._inputs if is_input else self._outputs
            own = tuple(event for event in events if event.place == place)
            side.setdefault(component, {})[name] = _ChangedPort(port, own)

    def inputs(self, component: str, values: Values, time_ns: int, layer: int) -> Values:
        """Inputs of a component after events; an unconnected input starts from its start value."""
        return self._changed(self._inputs.get(component, {}), values, time_ns, layer)

    def outputs(self, component: str, values: Values, time_ns: int, layer: int) -> Values:
        """Outputs of a component after events, as the others see them."""
        return self._changed(self._outputs.get(component, {}), values, time_ns, layer)

    def in_effect(self, time_ns: int, layer: int) -> bool:
        """Whether any value is changed: an override or bias has begun that no later reset cancels."""
        ports = [port for side in (self._inputs, self._outputs) for own in side.values() for port in own.values()]
        return any(port.is_changed(time_ns, layer) for port in ports)

    @staticmethod
    def _changed(ports: Mapping[str, _ChangedPort], values: Values, time_ns: int, layer: int) -> Values:
        if not ports:
            return values
        return {**values, **{name: port.value(values.get(name), time_ns, layer) for name, port in ports.items()}}


def find_port(component: HasPorts, name: str) -> tuple[Port, bool]:
    """The port of that name and whether it is an input, which goes before an output. Raises LookupError."""
    for ports, is_input in ((component.inputs, True), (component.outputs, False)):
        for port in ports:
            if port.name == name:
                return port, is_input
    raise LookupError(name)


@dataclass(frozen=True)
class _ChangedPort:
    """A port and its events in the order of the file."""

    port: Port
    events: tuple[Event, ...]

    def value(self, given: NDArray[Any] | None, time_ns: int, layer: int) -> NDArray[Any]:
        original = self.port.start_value() if given is None else given
        value = original
        for event in self.events:
            if event.has_begun(time_ns, layer):
                value = event.applied(value, original, layer)
        value = value.view()
        value.flags.writeable = False
        return value

    def is_changed(self, time_ns: int, layer: int) -> bool:
        changed = np.zeros(self.port.shape, dtype=np.bool_)
        for event in self.events:
            if event.has_begun(time_ns, layer):
                changed[... if event.cells is None else event.cells] = event.action != "reset"
        return bool(changed.any())


def _range(values: NDArray[Any]) -> str:
    low, high = values.min(), values.max()
    return f"{low:.6g}" if low == high else f"{low:.6g} .. {high:.6g}"
