"""Connections of an .ssp of any tool, joined to the arrays that inkloop has."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from math import isclose
from typing import Any

from inkloop.errors import nearest
from inkloop.exchange.ssp.contents import places
from inkloop.exchange.ssp.structure import SSC, SSD, Node, Structure, converts_units, flat_name, linear
from inkloop.fmu import FmuDescription, Variable
from inkloop.units import Conversion, key_of, unit_conversion

_ROUNDING = 1e-12
"""Relative error of a gain that several units on the way make."""


def connections(
    structure: Structure, root_units: Mapping[str, str], known: Mapping[str, FmuDescription], errors: list[str]
) -> list[dict[str, Any]]:
    """Tables of [[connections]] between components; those to the outermost system are left to the scenario's wiring."""
    wires = _Wires(structure, root_units, known)
    for system, connection in structure.connections():
        wires.add(system, connection, errors)
    joined: dict[tuple[str, str, str, str], dict[tuple[int, int], Conversion]] = {}
    for source in wires.outputs():
        for target, line in wires.from_output(source, errors):
            ends = [(flat_name(path), *wires.places[path][name]) for path, name in (source, target)]
            (giver, output, of), (taker, port, to) = ends
            joined.setdefault((giver, output, taker, port), {})[of, to] = line
    return list(_tables(joined, known, errors))


class _Wires:
    """The connections of a structure as a graph of connectors, walked from each output to the inputs that it feeds."""

    def __init__(
        self, structure: Structure, root_units: Mapping[str, str], known: Mapping[str, FmuDescription]
    ) -> None:
        self._structure, self._root_units, self._known = structure, root_units, known
        described = {path: known[name] for path in structure.components if (name := flat_name(path)) in known}
        self.places = {path: places(description) for path, description in described.items()}
        self._edges: dict[Node, list[tuple[Node, ET.Element]]] = {}

    def add(self, system: tuple[str, ...], connection: ET.Element, errors: list[str]) -> None:
        """Add a connection, unless one of its ends is left out or wrong."""
        start, end = (self._node(system, connection, which, errors) for which in ("start", "end"))
        if start and end and not self._is_of_parameters(start, end, errors):
            self._edges.setdefault(start, []).append((end, connection))
            self._edges.setdefault(end, []).append((start, connection))

    def _is_of_parameters(self, start: Node, end: Node, errors: list[str]) -> bool:
        """Whether a connection leads to a parameter of a component, with an error if it comes from another one."""
        ways = {node: self._variable(node).causality for node in (start, end) if node[0] in self.places}
        odd = [node for node, way in ways.items() if way not in ("input", "output")]
        if odd and len(ways) == 2:
            ends = " and ".join(map(self._shown, ways))
            wrong = f"a connection joins {ends}; inkloop feeds inputs, give parameters a value in a parameter set"
            errors += [wrong] if wrong not in errors else []
        return bool(odd)

    def outputs(self) -> list[Node]:
        """Connected outputs of components."""
        return [node for node in self._edges if node[0] in self.places and self._variable(node).causality == "output"]

    def from_output(self, source: Node, errors: list[str]) -> Iterator[tuple[Node, Conversion]]:
        """Each connector of a component that an output feeds, and the line on the way, apart from the units."""
        unit = self._variable(source).unit
        waiting: list[tuple[Node, Conversion, str]] = [(source, Conversion(1.0), unit)]
        nodes, passed = {source}, set[ET.Element]()
        while waiting:
            here, line, own = waiting.pop()
            for there, connection in self._edges[here]:
                is_output = there[0] in self.places and self._variable(there).causality == "output"
                if connection in passed or is_output:
                    continue
                passed.add(connection)
                if there in nodes:
                    errors.append(f"{self._shown(source)} feeds {self._shown(there)} by two ways; keep one connection")
                    continue
                nodes.add(there)
                its = self._unit(there, own)
                place = f"{self._shown(here)} to {self._shown(there)}"
                arrived = line.then(_passage(connection, own, its, place, errors))
                if there[0] in self.places:
                    yield there, _without_units(arrived, unit_conversion(unit, its) or Conversion(1.0))
                else:
                    waiting.append((there, arrived, its))

    def _variable(self, node: Node) -> Variable:
        path, name = node
        return self._known[flat_name(path)].variables[self.places[path][name][0]]

    def _shown(self, node: Node) -> str:
        """A connector in a message: the variable where FMI 2 scatters it."""
        path, name = node
        return ".".join((*path, self.places[path][name][0] if path in self.places else name))

    def _unit(self, node: Node, arriving: str) -> str:
        """The unit of a connector; the arriving one where that of a system names none, or this one by its name."""
        if node[0] in self.places:
            return self._variable(node).unit
        connector = self._structure.connector(node)
        kind = None if connector is None else next((each for each in connector if each.tag.startswith(SSC)), None)
        unit = (None if kind is None else kind.get("unit")) or arriving
        return arriving if unit == arriving and unit not in self._root_units else self._root_units.get(unit, unit)

    def _node(self, system: tuple[str, ...], connection: ET.Element, which: str, errors: list[str]) -> Node | None:
        """An end of a connection; None for one of the outermost system, or one that is left out or wrong."""
        element, connector = connection.get(f"{which}Element"), connection.get(f"{which}Connector", "")
        path = system if element is None else (*system, element)
        known: list[str] = []
        if path in self.places:
            known = list(self.places[path])
        elif path in self._structure.systems:
            declared = self._structure.systems[path].findall(f"{SSD}Connectors/{SSD}Connector")
            known = [each.get("name", "") for each in declared]
        elif path in self._structure.components or path in self._structure.refused:
            return None
        else:
            errors.append(
                f"a connection names component {element!r}; {nearest(path[-1], self._structure.names(system))}"
            )
            return None
        if not path:
            return None
        if connector not in known:
            advice = nearest(connector, known) if known else "it declares no connectors"
            errors.append(f"a connection names {'.'.join(path)}.{connector}; {advice}")
            return None
        return path, connector


def _passage(connection: ET.Element, unit: str, to: str, place: str, errors: list[str]) -> Conversion:
    """The line of one connection, between numbers in these units."""
    line = linear(connection, f"the connection from {place}", errors)
    units = unit_conversion(unit, to) if converts_units(connection) else Conversion(1.0)
    if units is None and "1" not in (unit, to) and line == Conversion(1.0):
        needed = "same quantity needed, or a LinearTransformation"
        wrong = f"the connection from {place} goes from [{unit}] to [{to}]; {needed}"
        errors += [wrong] if wrong not in errors else []
    return (units or Conversion(1.0)).then(line)


def _without_units(line: Conversion, units: Conversion) -> Conversion:
    """The line after the conversion of units that comes before it."""
    gain = line.factor / units.factor
    gain = 1.0 if isclose(gain, 1.0, rel_tol=_ROUNDING) else gain
    return Conversion(gain, line.offset - gain * units.offset)


def _tables(
    joined: Mapping[tuple[str, str, str, str], Mapping[tuple[int, int], Conversion]],
    known: Mapping[str, FmuDescription],
    errors: list[str],
) -> Iterator[dict[str, Any]]:
    for (source, output, target, port), elements in joined.items():
        place = f"{source}.{output} to {target}.{port}"
        count = max(1, len(known[target].variables[port].elements))
        if sorted(elements) != [(number, number) for number in range(count)]:
            errors.append(
                f"{place}: {len(elements)} of {count} elements are connected, or not each to its like; "
                "inkloop connects whole arrays, element to element"
            )
            continue
        lines = set(elements.values())
        if len(lines) > 1:
            errors.append(f"{place}: elements have different transformations; inkloop takes one for the array")
            continue
        gain, offset = lines.pop()
        ends = [known[name].variables[of].unit for name, of in ((source, output), (target, port))]
        units = unit_conversion(*ends)
        if units and units.offset != 0.0 and (gain, offset) != (1.0, 0.0):
            errors.append(
                f"{place}: inkloop converts [{ends[0]}] to [{ends[1]}] and takes no transformation on top; leave it "
                'out, or add suppressUnitConversion="true" where it is that conversion'
            )
            continue
        table: dict[str, Any] = {"source": f"{source}.{output}", "target": f"{target}.{port}"}
        if gain != 1.0:
            table["gain"] = gain
        if offset != 0.0:
            key = key_of("offset", known[target].variables[port].unit)
            table[key.text] = offset / key.factor
        yield table
