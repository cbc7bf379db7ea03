"""Parameters and connections of an .ssp of any tool, joined to the arrays that inkloop has."""

from __future__ import annotations

import posixpath
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Iterator, Mapping
from typing import Any, TypeAlias
from urllib.parse import unquote

import numpy as np

from inkloop.fmu import FmuDescription, Variable
from inkloop.suggest import nearest
from inkloop.units import conversion, key_of

_NAMESPACE = "http://ssp-standard.org/SSP1/SystemStructure"
SSC = f"{{{_NAMESPACE}Common}}"
SSD = f"{{{_NAMESPACE}Description}}"
SSV = f"{{{_NAMESPACE}ParameterValues}}"

Places: TypeAlias = Mapping[str, tuple[str, int]]
"""Name in the .ssp -> variable in inkloop, and the index of its element."""


def places(description: FmuDescription) -> dict[str, tuple[str, int]]:
    """The names of an FMU's variables; one that FMI 2 scatters has a name for each element."""
    return {
        name: (variable.name, number)
        for variable in description.variables.values()
        for number, name in enumerate(variable.elements or (variable.name,))
    }


def member_of(source: str) -> str:
    """The member of the archive that a URI relative to the .ssd names, `./resources/a%20b.fmu` for example."""
    return posixpath.normpath(unquote(source))


Value = float | int | bool | str


def parameters(
    system: ET.Element, archive: zipfile.ZipFile, known: Mapping[str, FmuDescription], errors: list[str]
) -> dict[str, dict[str, Any]]:
    """Component -> parameter -> value in the unit of the FMU, a nested list for an array."""
    scopes = [(system, "")]
    scopes += [(element, f"{element.get('name')}.") for element in system.findall(f"{SSD}Elements/{SSD}Component")]
    elements: dict[str, dict[str, dict[int, list[Value]]]] = {}
    names = {name: _names(description) for name, description in known.items()}
    for scope, begin in scopes:
        for name, entry in _entries(scope, archive, errors):
            component, _, parameter = (begin + name).partition(".")
            if component not in known:
                errors.append(
                    f"parameter {begin + name}: there is no component {component!r}; {nearest(component, known)}"
                )
                continue
            if parameter not in names[component]:
                advice = nearest(parameter, names[component])
                errors.append(f"parameter {begin + name} is none of {component}; {advice}")
                continue
            variable, number = names[component][parameter]
            found = _values(entry, known[component].variables[variable], begin + name, errors)
            elements.setdefault(component, {}).setdefault(variable, {})[number] = found
    return {
        component: {name: _joined(known[component], name, parts) for name, parts in parameters.items()}
        for component, parameters in elements.items()
    }


def _names(description: FmuDescription) -> Places:
    """The names of its parameters."""
    settable = description.parameters
    return {name: place for name, place in places(description).items() if place[0] in settable}


def _entries(scope: ET.Element, archive: zipfile.ZipFile, errors: list[str]) -> Iterator[tuple[str, ET.Element]]:
    """Name and typed value of each parameter bound to an element of the system."""
    for binding in scope.findall(f"{SSD}ParameterBindings/{SSD}ParameterBinding"):
        if binding.find(f"{SSD}ParameterMapping") is not None:
            errors.append(
                "a parameter binding has a mapping (.ssm), which inkloop does not take; name parameters as FMUs do"
            )
            continue
        source, prefix = binding.get("source"), binding.get("prefix", "")
        if source is not None and binding.get("sourceBase") == "component":
            errors.append(
                f"parameters {source!r} lie in an FMU (sourceBase), which inkloop does not open; move them out"
            )
            continue
        root = binding.find(f"{SSD}ParameterValues/{SSV}ParameterSet")
        if source is not None:
            try:
                root = ET.fromstring(archive.read(member_of(source)))
            except (KeyError, ET.ParseError) as error:
                errors.append(f"parameters {source!r} cannot be read: {error}")
                continue
            if root.tag != f"{SSV}ParameterSet":
                errors.append(f"parameters {source!r} are no parameter set of SSP, but <{root.tag}>")
                continue
        for parameter in root.findall(f"{SSV}Parameters/{SSV}Parameter") if root is not None else ():
            entry = next((child for child in parameter if child.tag.startswith(SSV)), None)
            if entry is not None:
                yield prefix + parameter.get("name", ""), entry


def _values(entry: ET.Element, variable: Variable, place: str, errors: list[str]) -> list[Value]:
    texts = [entry.get("value", "")] if variable.items else entry.get("value", "").split()
    factor = 1.0
    if unit := entry.get("unit"):
        found = conversion(unit, variable.unit)
        factor = 1.0 if found is None else found
        if found is None:
            errors.append(f"parameter {place} is in [{unit}]; {variable.name} is in [{variable.unit}]")
    is_array = bool(variable.dimensions) and not variable.elements
    try:
        values = [_value(text, variable, factor) for text in texts]
    except ValueError:
        values = []
    if len(values) == 1 or (values and is_array):
        return values
    errors.append(f"parameter {place} is {entry.get('value')!r}; expected {variable.type}")
    return [0]


def _value(text: str, variable: Variable, factor: float) -> Value:
    kind = np.dtype(variable.dtype).kind
    if variable.items:
        return text if text in variable.items else int(text)
    if kind == "b":
        if text not in ("true", "false", "1", "0"):
            raise ValueError(text)
        return text in ("true", "1")
    return float(text) * factor if kind == "f" else int(text)


def _joined(description: FmuDescription, name: str, parts: Mapping[int, list[Value]]) -> Any:
    """One value, or the whole array: elements that no set gives keep their start value."""
    variable = description.variables[name]
    if not variable.dimensions:
        return parts[0][0]
    if not variable.elements:
        values = parts[0]
        shape = variable.shape(description.default_sizes)
        fits = len(values) == np.prod(shape)
        return np.asarray(values).reshape(shape).tolist() if fits else values
    starts = variable.start if len(variable.start) == len(variable.elements) else ("0",) * len(variable.elements)
    whole = [parts.get(number, [_value(text, variable, 1.0)])[0] for number, text in enumerate(starts)]
    return np.asarray(whole).reshape(variable.shape({})).tolist()


_End: TypeAlias = tuple[str, str, int]
_TRANSFORMATIONS = ("BooleanMappingTransformation", "IntegerMappingTransformation", "EnumerationMappingTransformation")


def connections(system: ET.Element, known: Mapping[str, FmuDescription], errors: list[str]) -> list[dict[str, Any]]:
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
