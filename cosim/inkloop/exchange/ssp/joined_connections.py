"""Read the connections of an .ssd as connections of a scenario, scalars joined to arrays."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from typing import Any, TypeAlias

from inkloop.exchange.ssp.names import SSC, SSD, Places, places
from inkloop.fmu import FmuDescription
from inkloop.suggest import nearest
from inkloop.units import conversion, key_of

_End: TypeAlias = tuple[str, str, int]
_TRANSFORMATIONS = ("BooleanMappingTransformation", "IntegerMappingTransformation", "EnumerationMappingTransformation")


def read(system: ET.Element, known: Mapping[str, FmuDescription], errors: list[str]) -> list[dict[str, Any]]:
    """Tables of [[connections]] between components; those to the system itself are left to the scenario's wiring."""
    names = {component: places(description) for component, description in known.items()}
    joined: dict[tuple[str, str, str, str], dict[tuple[int, int], tuple[float, float]]] = {}
    for element in system.findall(f"{SSD}Connections/{SSD}Connection"):
        if element.get("startElement") is None or element.get("endElement") is None:
            continue
        source, target = (_end(element, which, names, errors) for which in ("start", "end"))
        if source is None or target is None:
            continue
        if known[source[0]].variables[source[1]].causality != "output":  # start and end have no direction
            source, target = target, source
        line = _gain_and_offset(element, source, target, known, errors)
        joined.setdefault((*source[:2], *target[:2]), {})[source[2], target[2]] = line
    return list(_tables(joined, known, errors))


def _end(element: ET.Element, which: str, names: Mapping[str, Places], errors: list[str]) -> _End | None:
    component, connector = element.get(f"{which}Element", ""), element.get(f"{which}Connector", "")
    if component not in names:
        errors.append(f"a connection names component {component!r}; {nearest(component, names)}")
    elif connector not in names[component]:
        errors.append(f"a connection names {component}.{connector}; {nearest(connector, names[component])}")
    else:
        return component, *names[component][connector]
    return None


def _gain_and_offset(
    element: ET.Element, source: _End, target: _End, known: Mapping[str, FmuDescription], errors: list[str]
) -> tuple[float, float]:
    """In the unit of the target, after any conversion."""
    place = f"the connection from {source[0]}.{source[1]} to {target[0]}.{target[1]}"
    if other := [tag for tag in _TRANSFORMATIONS if element.find(f"{SSC}{tag}") is not None]:
        errors.append(f"{place} has a {other[0]}; inkloop takes LinearTransformation only")
    line = element.find(f"{SSC}LinearTransformation")
    factor, offset = 1.0, 0.0
    if line is not None:
        try:
            factor, offset = float(line.get("factor", "1")), float(line.get("offset", "0"))
        except ValueError:
            errors.append(f"{place}: factor {line.get('factor')!r}, offset {line.get('offset')!r}; expected numbers")
    if element.get("suppressUnitConversion") in ("true", "1"):
        units = [known[component].variables[variable].unit for component, variable, _ in (source, target)]
        factor /= conversion(units[0], units[1]) or 1.0
    return factor, offset


def _tables(
    joined: Mapping[tuple[str, str, str, str], Mapping[tuple[int, int], tuple[float, float]]],
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
        table: dict[str, Any] = {"source": f"{source}.{output}", "target": f"{target}.{port}"}
        if gain != 1.0:
            table["gain"] = gain
        if offset != 0.0:
            key = key_of("offset", known[target].variables[port].unit)
            table[key.text] = offset / key.factor
        yield table
