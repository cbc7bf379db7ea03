"""The parameters of an .ssp, from parameter sets in it or in its .ssd, joined to arrays."""

from __future__ import annotations

import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from inkloop.exchange.ssp.names import SSD, SSV, Places, member_of, places
from inkloop.fmu import FmuDescription, Variable
from inkloop.suggest import nearest
from inkloop.units import conversion

Value = float | int | bool | str


def read(
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
