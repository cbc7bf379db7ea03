"""`[[buses]]`: which buses of FMUs are one, and what is missing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from inkloop.components.kind import Checked
from inkloop.fmu.bus_links import BusEnd, BusLink
from inkloop.suggest import nearest
from inkloop.tables.schema import BusTable


def bus_links(tables: Sequence[BusTable], checked: Mapping[str, Checked]) -> tuple[list[BusLink], list[str]]:
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
        wrong = list(_errors(place, table.between, known, used))
        used |= dict.fromkeys(table.between, number)
        errors += wrong
        if not wrong:
            (one, first), (other, second) = (known[end] for end in table.between)
            links.append(BusLink((one, other), ideal=not (first or second)))
    errors += [_unlinked(end) for end in known if end not in used]
    return links, errors


def _errors(place: str, ends: Sequence[str], known: Mapping[str, object], used: Mapping[str, int]) -> Iterator[str]:
    if len(set(ends)) != 2:
        yield (
            f"{place} has {len(set(ends))} ends; expected two different ones: of more partners each is connected to a "
            "bus simulation, an FMU of yours"
        )
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
