"""From the `[[events]]` of a scenario to events of its ports, with all errors."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap, HasPorts, Port
from inkloop.contract import LAYER_COMMAND
from inkloop.course.events import Event, find_port
from inkloop.errors import nearest
from inkloop.tables.messages import read_quantities
from inkloop.tables.schema import EventTable
from inkloop.units import NS_PER_S, conversion, key_of


def read_events(
    tables: Sequence[EventTable],
    components: Mapping[str, HasPorts],
    nozzle_pitch: Mapping[str, int],
    pitch: float,
    unknown: Collection[str] = (),
) -> tuple[list[Event], list[str]]:
    """Events in the order of the file, and every error, each with its place; with errors the list is not whole.

    nozzle_pitch: component -> its number of nozzles, of those that have it; pitch: distance of cells [m]; unknown:
    further components, whose ports are not known.
    """
    events: list[Event] = []
    errors: list[str] = []
    outputs = [port.name for part in components.values() for port in part.outputs]
    commands = bool(unknown) or LAYER_COMMAND in outputs
    for number, table in enumerate(tables):
        place = f"events.[{number}]"
        own = _moment_errors(table, commands)
        port, wrong = find_event_port(table.port, components, unknown)
        own += wrong
        if port is not None:
            reader = _Reader(table, port, nozzle_pitch.get(table.port.partition(".")[0]), pitch)
            event = reader.event()
            own += reader.errors
            if not own:
                events.append(event)
        errors += [f"{place}.{error}" for error in own]
    return events, errors


class _Reader:
    """Reads one table for the port it names; `errors` collects its errors."""

    def __init__(self, table: EventTable, port: Port, nozzle_pitch: int | None, pitch: float) -> None:
        self._table = table
        self._port = port
        self._nozzle_pitch = nozzle_pitch
        self._pitch = pitch
        self.errors: list[str] = []

    def event(self) -> Event:
        """The event; of use if there are no errors."""
        table, port = self._table, self._port
        units = {} if table.action == "reset" else {"value": port.unit}
        if table.action == "bias":
            units["per_layer"] = port.unit
        values, errors = read_quantities(table.quantities, units, type(table).model_fields)
        self.errors += errors
        value = self._array(*values["value"]) if "value" in values else None
        per_layer = self._array(*values["per_layer"]) if "per_layer" in values else None
        if table.action == "bias" and port.dtype == "bool":
            self.errors.append(f"action is 'bias', but {table.port} is true or false; override it")
        if per_layer is not None and table.at_layer is None:
            self.errors.append("per_layer needs at_layer, the layer from which it grows; give at_layer")
        value = self._tilted(value)
        if value is None and per_layer is not None:
            value = np.zeros((), dtype=port.dtype)
        if value is None and table.action != "reset" and not errors and "value" not in values:
            self.errors.append(
                f"{key_of('value', port.unit).text} is missing; add what to {table.action} {table.port} with"
            )
        moment = None if table.at_time_s is None else round(table.at_time_s * NS_PER_S)
        return Event(table.port, table.action, table.at_layer, moment, value, per_layer, self._cells())

    def _array(self, key: str, value: object) -> NDArray[Any] | None:
        port = self._port
        try:
            array = np.asarray(value)
        except ValueError:
            array = np.asarray("ragged")
        kinds = {"b": "b", "i": "iu", "f": "iuf"}[np.dtype(port.dtype).kind]
        if array.dtype.kind not in kinds or not np.isfinite(array).all():
            what = {"b": "true or false", "i": "a whole number", "f": "a finite number"}[np.dtype(port.dtype).kind]
            found = self._table.quantities[key]
            self.errors.append(f"{key} is {found!r}; expected {what}, or an array of them")
            return None
        if array.shape not in ((), port.shape):
            self.errors.append(f"{key} has shape {array.shape}; {self._table.port} takes a number or {port.shape}")
            return None
        return array.astype(port.dtype)

    def _tilted(self, value: NDArray[Any] | None) -> NDArray[Any] | None:
        """The value and a plane through the centre of the grid, whose slopes are tilt_x and tilt_y."""
        table, port = self._table, self._port
        if not (table.tilt_x or table.tilt_y):
            return value
        to_unit = conversion("m", port.unit)
        if table.action != "bias" or len(port.shape) != 2 or to_unit is None:
            self.errors.append(
                f"tilt_x and tilt_y are of a bias on a map of heights; {table.action} of {table.port} has none"
            )
            return value
        x, y = (self._pitch * (np.arange(count) - (count - 1) / 2) for count in port.shape)
        plane = table.tilt_x * x[:, None] + table.tilt_y * y
        return plane * to_unit + (0.0 if value is None else value)

    def _cells(self) -> BoolMap | None:
        table, shape = self._table, self._port.shape
        if table.cells is None and table.nozzles is None:
            return None
        if len(shape) != 2:
            self.errors.append(f"{table.port} has no cells; leave cells and nozzles out")
            return None
        chosen = np.zeros(shape, dtype=np.bool_)
        for cell in table.cells or ():
            if all(0 <= index < count for index, count in zip(cell, shape, strict=True)):
                chosen[tuple(cell)] = True
            else:
                self.errors.append(f"cells has {cell}; the grid of {table.port} is {shape[0]} x {shape[1]}")
        if table.nozzles is not None:
            chosen |= self._cells_of_nozzles(table.nozzles, shape)
        return chosen

    def _cells_of_nozzles(self, nozzles: Sequence[int], shape: tuple[int, ...]) -> BoolMap:
        """Cells whose droplets come from the nozzles, in whichever pass: cell (i, j) from j modulo their number."""
        count = self._nozzle_pitch
        if count is None:
            component = self._table.port.partition(".")[0]
            self.errors.append(
                f"nozzles: {component} does not declare their number; give components.{component}.nozzle_pitch, "
                "or select by cells"
            )
            return np.zeros(shape, dtype=np.bool_)
        wrong = [nozzle for nozzle in nozzles if not 0 <= nozzle < count]
        self.errors += [
            f"nozzles has {nozzle}; expected 0 to {count - 1} (nozzle_pitch is {count})" for nozzle in wrong
        ]
        of_line = np.isin(np.arange(shape[1]) % count, nozzles)
        return np.broadcast_to(of_line, shape).copy()


def _moment_errors(table: EventTable, commands: bool) -> list[str]:
    if (table.at_layer is None) == (table.at_time_s is None):
        problem = "both are given" if table.at_layer is not None else "neither is given"
        return [f"at_layer, at_time_s: {problem}; give one of them"]
    if table.at_layer is not None and not commands:
        return ["at_layer: no component commands layers; give at_time_s"]
    return []


def find_event_port(
    place: str, components: Mapping[str, HasPorts], unknown: Collection[str] = ()
) -> tuple[Port | None, list[str]]:
    """The port at "component.port", and the error of the place; neither for a component with unknown ports."""
    component, _, name = place.partition(".")
    if component in unknown:
        return None, []
    if component not in components:
        known = nearest(component, (*components, *unknown))
        return None, [f"port is {place!r}: there is no component {component!r}; {known}"]
    try:
        return find_port(components[component], name)[0], []
    except LookupError:
        part = components[component]
        ports = [port.name for port in (*part.inputs, *part.outputs)]
        return None, [f"port is {place!r}: {component} has no port {name!r}; {nearest(name, ports)}"]
