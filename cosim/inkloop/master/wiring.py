"""Connections between components, their errors, and the values that travel on them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from inkloop.component import HasPorts, Port, Values
from inkloop.errors import ComponentError, nearest
from inkloop.master.orientation import OWN, Orientation
from inkloop.units import Conversion, is_known, unit_conversion


@dataclass(frozen=True)
class Connection:
    """An output, `source`, that feeds an input, `target`; both "component.port".

    The input is gain * output + offset, the output in the unit of the input, the offset too. gain None: 1 where the
    units are known, none to convert unknown ones; orientation: of a map in the input.
    """

    source: str
    target: str
    gain: float | None = None
    offset: float = 0.0
    orientation: Orientation = OWN

    @property
    def source_parts(self) -> tuple[str, str]:
        """Component and port of the output."""
        return _parts(self.source)

    @property
    def target_parts(self) -> tuple[str, str]:
        """Component and port of the input."""
        return _parts(self.target)


@dataclass(frozen=True)
class Transfer:
    """Conversion of a value between two ports: value * factor + offset, in the unit, type and orientation of the
    input.
    """

    factor: float = 1.0
    offset: float = 0.0
    dtype: str = "float64"
    orientation: Orientation = OWN

    @classmethod
    def of(cls, connection: Connection, source: Port, target: Port) -> Transfer:
        """The transfer of a connection without errors between its two ports."""
        units = unit_conversion(source.unit, target.unit) or Conversion(1.0)
        gain = 1.0 if connection.gain is None else connection.gain
        return cls(units.factor * gain, units.offset + connection.offset, target.dtype, connection.orientation)

    @property
    def is_plain(self) -> bool:
        """Whether numbers arrive unchanged."""
        return self.factor == 1.0 and self.offset == 0.0

    def __call__(self, value: NDArray[Any]) -> NDArray[Any]:
        """The converted value; the array itself if there is no conversion."""
        if self.is_plain and value.dtype == self.dtype and self.orientation.is_own:
            return value
        number = self.orientation.there(value).astype(self.dtype, order="C")
        arrived = number if self.is_plain else np.asarray(number * self.factor + self.offset, dtype=self.dtype)
        arrived.flags.writeable = False
        return arrived


def feeds(
    components: Mapping[str, HasPorts], connections: Sequence[Connection]
) -> dict[str, list[tuple[str, str, str, Transfer]]]:
    """By component, the sources of its inputs: input, component and output, and the conversion.

    The connections must have no errors.
    """
    inputs = {f"{name}.{port.name}": port for name, component in components.items() for port in component.inputs}
    outputs = {f"{name}.{port.name}": port for name, component in components.items() for port in component.outputs}
    found: dict[str, list[tuple[str, str, str, Transfer]]] = {name: [] for name in components}
    for connection in connections:
        target, port = connection.target_parts
        transfer = Transfer.of(connection, outputs[connection.source], inputs[connection.target])
        found[target].append((port, *connection.source_parts, transfer))
    return found


Feeds: TypeAlias = Mapping[str, Sequence[tuple[str, str, str, Transfer]]]
"""Result of `feeds`."""


def without_start(name: str, feeds: Feeds, outputs: Mapping[str, Values]) -> str | None:
    """Errors that prevent initialization: a component in a loop that gets an output without start value.

    outputs: start values, or those of components that are initialized, which are finite.
    """
    for port, source, output, _ in feeds[name]:
        if not np.isfinite(outputs[source][output]).all():
            return (
                f"{name}.{port} stands in a loop with {source}.{output}, which has no start value (it is not finite); "
                f"give the port a start, or put {source} before {name} in the scenario"
            )
    return None


def initial_order(feeds: Feeds) -> list[str]:
    """Components for initialization: sources before their targets; in a loop, the order of the scenario."""
    waiting, order = list(feeds), list[str]()
    while waiting:
        free = (n for n in waiting if not any(feed[1] in waiting and feed[1] != n for feed in feeds[n]))
        order.append(next(free, waiting[0]))
        waiting.remove(order[-1])
    return order


def check(components: Mapping[str, HasPorts], connections: Sequence[Connection]) -> list[str]:
    """Every error of the wiring, one sentence each; empty if the loop may run."""
    inputs, outputs = (
        {name: _ports(component, way) for name, component in components.items()} for way in ("input", "output")
    )
    errors: list[str] = []
    fed: dict[str, str] = {}
    for connection in connections:
        source = find(connection.source, outputs, "output", errors)
        target = find(connection.target, inputs, "input", errors)
        if source and target:
            errors += _mismatches(connection, source, target)
        if connection.target in fed:
            errors.append(
                f"{connection.target} is fed twice, by {fed[connection.target]} and {connection.source}; keep one"
            )
        fed[connection.target] = connection.source
    return errors


def _mismatches(connection: Connection, source: Port, target: Port) -> Iterator[str]:
    strange = {f"[{port.unit}]" for port in (source, target) if not is_known(port.unit) and port.unit != "1"}
    shape = connection.orientation.shape(source.shape)
    if not connection.orientation.is_own and len(shape) != 2:
        yield f"{connection.source} gives {_shape(source.shape)}; mirror and transpose turn maps: leave them out"
    units = unit_conversion(source.unit, target.unit)
    has_gain = bool(strange) and connection.gain is not None  # the gain converts one unit into the other
    is_one_quantity = has_gain or units is not None
    for what, found, expected, fits in (
        ("quantity", f"[{source.unit}]", f"[{target.unit}]", is_one_quantity),
        ("shape", _shape(shape), _shape(target.shape), shape == target.shape),
    ):
        if not fits:
            advice = f", or a gain that converts {found} into {expected}" if strange & {found, expected} else ""
            if what == "shape" and len(shape) == len(target.shape) == 2:
                is_turned = shape == target.shape[::-1]
                turned = "transpose in the connection, or in ports of an FMU, exchanges the axes"
                advice = f"; {turned if is_turned else 'write under [grid] the nx and ny of the one that has no other'}"
            yield f"{connection.source} gives {found}, {connection.target} takes {expected}: same {what} needed{advice}"
    if not holds(target.dtype, source.dtype):
        yield (
            f"{connection.source} gives {source.dtype}, {connection.target} takes {target.dtype}, which does not hold "
            "all its values; put a component between them that rounds or limits "
            "(docs/how-to/bring-your-own-component.md)"
        )
    if units and units.offset != 0.0 and (connection.gain is not None or connection.offset != 0.0):
        yield (
            f"{connection.source} gives [{source.unit}], {connection.target} takes [{target.unit}]: these are "
            "converted by themselves, offset included; leave gain and offset out"
        )
    elif is_one_quantity and not Transfer.of(connection, source, target).is_plain and not _is_float(target):
        yield (
            f"{connection.target} is {target.dtype}; a gain, an offset or another unit needs floating-point values; "
            "leave gain and offset out"
        )


def _ports(component: HasPorts, direction: str) -> dict[str, Port]:
    ports = component.inputs if direction == "input" else component.outputs
    return {port.name: port for port in ports}


def find(place: str, ports: Mapping[str, Mapping[str, Port]], direction: str, errors: list[str]) -> Port | None:
    """The port at "component.port"; if there is none, `errors` gets a sentence with similar names."""
    component, name = _parts(place)
    if component not in ports:
        errors.append(f"{place}: there is no component {component!r}; {nearest(component, ports)}")
    elif name not in ports[component]:
        known = nearest(name, ports[component]) if ports[component] else f"it has no {direction}s"
        errors.append(f"{place}: {component} has no {direction} {name!r}; {known}")
    else:
        return ports[component][name]
    return None


def _parts(place: str) -> tuple[str, str]:
    component, _, port = place.partition(".")
    return component, port


def holds(wide: str, narrow: str) -> bool:
    """Whether every value of the type `narrow` is one of the type `wide`: 64-bit integers are no float64."""
    target, source = np.dtype(wide), np.dtype(narrow)
    is_beyond = target.kind == "f" and source.kind in "iu" and source.itemsize >= target.itemsize
    return target == source or (np.can_cast(source, target, "safe") and target.kind != "b" and not is_beyond)


def _is_float(port: Port) -> bool:
    return port.dtype.startswith("float")


def _shape(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape)) or "a scalar"


def by_name(outputs: object) -> Values:
    """The outputs that a component has returned. Raises ComponentError for anything but a mapping."""
    if not isinstance(outputs, Mapping):
        raise ComponentError(f"a {type(outputs).__name__} was returned; needs the outputs by name")
    return outputs


def checked_output(port: Port, outputs: Values, must_be_finite: bool) -> NDArray[Any]:
    """Its value among `outputs`, read-only, in the declared shape and type. Raises ComponentError."""
    if port.name not in outputs:
        raise ComponentError(f"output {port.name} was declared but not returned")
    value = np.asarray(outputs[port.name])
    if value.shape != port.shape:
        raise ComponentError(f"output {port.name} has shape {value.shape}, declared {port.shape}")
    if value.dtype != port.dtype:
        if not np.can_cast(value.dtype, port.dtype, "same_kind"):
            raise ComponentError(f"output {port.name} is {value.dtype}, declared {port.dtype}")
        value = value.astype(port.dtype)
    if must_be_finite and not (np.isfinite(value).all() if value.shape else isfinite(value)):
        cell = tuple(int(i) for i in np.argwhere(~np.isfinite(value))[0])
        raise ComponentError(
            f"output {port.name} is {value[cell]} in cell {cell}" if cell else f"output {port.name} is {value}"
        )
    if value.flags.writeable:
        value = value.view()
        value.flags.writeable = False  # consumers share it
    return value
