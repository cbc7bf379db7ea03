"""The loop of one print: components with checked options, their connections and events, and all errors."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from inkloop.component import Component, HasPorts, Ports
from inkloop.components.kind import Bench, Checked
from inkloop.course.events import Event
from inkloop.course.layer_course import contract_connections, open_inputs
from inkloop.errors import nearest
from inkloop.fmu.bus import BusEnd, BusLink
from inkloop.master.orientation import Orientation
from inkloop.master.wiring import Connection, check
from inkloop.scenario.events import read_events
from inkloop.scenario.validation import end_errors, known_ports, mix_errors, shadow_errors
from inkloop.tables.messages import read_quantities
from inkloop.tables.schema import BenchTable, BusTable, ComponentTable, ConnectionTable, ScenarioFile


@dataclass(frozen=True)
class Loop:
    """Components by name in file order, and their connections.

    errors: of connections and events, those of the components' options left out; connections and events are of use
    if there are none.
    """

    checked: Mapping[str, Checked]
    ports: Mapping[str, Ports]
    connections: list[Connection]
    events: list[Event]
    buses: list[BusLink]
    errors: list[str]

    @property
    def notes(self) -> list[str]:
        """Warnings of components."""
        return [f"components.{name}: {note}" for name, found in self.checked.items() for note in found.notes]

    @classmethod
    def of(cls, tables: ScenarioFile, components: Mapping[str, ComponentTable], checked: Mapping[str, Checked]) -> Loop:
        """Connect checked components by the tables of a scenario."""
        ports, unknown = known_ports(checked)
        connections: list[Connection] = []
        if unknown:
            errors = end_errors(ports, unknown, [(c.source, c.target) for c in tables.connections])
        else:
            connections, errors = _connected(tables.connections, ports)
        errors += _single_errors(checked)
        counts = {name: table.options.get("nozzle_pitch") for name, table in components.items()}
        nozzle_pitch = {name: count for name, count in counts.items() if isinstance(count, int)}
        events, wrong = read_events(tables.events, ports, nozzle_pitch, tables.grid.pitch, unknown)
        buses, missing = ([], []) if unknown else _bus_links(tables.buses, checked)
        return cls(checked, ports, connections, events, buses, errors + wrong + missing)

    def build(self, bench: BenchTable, folder: Path | None) -> dict[str, Component]:
        """A component of each, for the caller to terminate; folder: of the run. Raises FmuError."""
        components: dict[str, Component] = {}
        shared = Bench(bench, folder)
        try:
            for name, checked in self.checked.items():
                components[name] = checked.make(shared, name)
        except BaseException:
            for component in components.values():
                component.terminate()
            raise
        return components


def _single_errors(checked: Mapping[str, Checked]) -> list[str]:
    """Components that need a second instance of an FMU that a process takes one of."""
    first: dict[Path, str] = {}
    errors = []
    for name, found in checked.items():
        if found.single is not None and first.setdefault(found.single, name) != name:
            errors.append(
                f"components.{name}: {found.single.name} can be instantiated once per process, and components."
                f"{first[found.single]} has it; take it out, or export it without canBeInstantiatedOnlyOncePerProcess"
            )
    return errors


def _connected(tables: list[ConnectionTable], ports: Mapping[str, HasPorts]) -> tuple[list[Connection], list[str]]:
    """The connections of the file and those of the layer contract, and all errors in them."""
    errors: list[str] = []
    explicit = [_connection(f"connections.[{number}]", table, ports, errors) for number, table in enumerate(tables)]
    taken = {connection.target for connection in explicit}
    wires = [wire for wire in contract_connections(ports) if wire.target not in taken]
    if mixed := mix_errors(ports):  # what they leave unconnected is no error of its own
        return [], errors + mixed
    connections = explicit + wires
    errors += [*check(ports, connections), *open_inputs(ports, connections)]
    return connections, errors + shadow_errors(ports, connections)


def _connection(place: str, table: ConnectionTable, ports: Mapping[str, HasPorts], errors: list[str]) -> Connection:
    """The connection of a table, its offset in the unit of its input; errors of the keys are appended to `errors`."""
    component, _, name = table.target.partition(".")
    inputs = {port.name: port for port in ports[component].inputs} if component in ports else {}
    unit = inputs[name].unit if name in inputs else "1"
    values, wrong = read_quantities(table.quantities, {"offset": unit}, ConnectionTable.model_fields)
    key, offset = values.get("offset", ("offset", 0.0))
    if isinstance(offset, bool) or not isinstance(offset, int | float) or not math.isfinite(offset):
        wrong.append(f"{key} is {table.quantities[key]!r}; expected a finite number")
        offset = 0.0
    errors += [f"{place}.{error}" for error in wrong]
    orientation = Orientation(table.mirror, table.transpose)
    return Connection(table.source, table.target, table.gain, float(offset), orientation)


def _bus_links(tables: Sequence[BusTable], checked: Mapping[str, Checked]) -> tuple[list[BusLink], list[str]]:
    """The links of the tables, and all errors: ends that there are not, twice, or that no table names."""
    known = {
        str(BusEnd(name, bus)): (BusEnd(name, bus), found.is_bus_simulation)
        for name, found in checked.items()
        for bus in found.buses
    }
    errors: list[str] = []
    links: list[BusLink] = []
    used: dict[str, int] = {}
    for number, table in enumerate(tables):
        place = f"buses.[{number}].between"
        wrong = list(_bus_errors(place, table.between, known, used))
        used |= dict.fromkeys(table.between, number)
        errors += wrong
        if not wrong:
            (one, first), (other, second) = (known[end] for end in table.between)
            links.append(BusLink((one, other), ideal=not (first or second)))
    errors += [_unlinked(end) for end in known if end not in used]
    return links, errors


def _bus_errors(place: str, ends: Sequence[str], known: Mapping[str, object], used: Mapping[str, int]) -> Iterator[str]:
    if len(ends) != 2 or len(set(ends)) != 2:
        yield (
            f"{place} is {', '.join(ends) or 'empty'}; expected two different buses: of more partners each is "
            "connected to a bus simulation, an FMU of yours"
        )
        return
    for end in ends:
        if end not in known:
            yield f"{place}: {end} is no bus of an FMU; {nearest(end, known) if known else 'no component has one'}"
        elif end in used:
            yield f"{place}: {end} is in buses.[{used[end]}] already; more than two are joined by a bus simulation"


def _unlinked(end: str) -> str:
    component, _, bus = end.partition(".")
    return (
        f"components.{component}: its bus {bus} has no partner; name both under [[buses]], as in "
        f'between = ["{end}", "other.its_bus"], or print through it with bench.interface = "inkloop_fmu"'
    )
