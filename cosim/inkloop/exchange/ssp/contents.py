"""Parameters that an .ssp of any tool binds, joined to the arrays that inkloop has."""

from __future__ import annotations

import posixpath
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple, TypeAlias
from urllib.parse import unquote

import numpy as np

from inkloop.errors import nearest
from inkloop.exchange.ssp.structure import SSD, SSM, SSV, Structure, converts_units, flat_name, linear, units_in
from inkloop.fmu import FmuDescription, Variable
from inkloop.fmu.variable import TEXT
from inkloop.limits import XmlError, parsed_xml
from inkloop.units import Conversion, unit_conversion

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
_UNCHANGED = Conversion(1.0)


class Way(NamedTuple):
    """From a parameter set to a parameter: a line, after the conversion of units unless that is suppressed."""

    line: Conversion = _UNCHANGED
    converts: bool = True


class Entry(NamedTuple):
    """A parameter that a binding gives: its typed value, the units of its file, and its way through a mapping."""

    name: str
    value: ET.Element
    units: Mapping[str, str]
    way: Way


def parameters(
    structure: Structure,
    root_units: Mapping[str, str],
    archive: zipfile.ZipFile,
    known: Mapping[str, FmuDescription],
    errors: list[str],
) -> dict[str, dict[str, Any]]:
    """Component -> parameter -> value in the unit of the FMU, a nested list for an array.

    root_units: units that the .ssd defines. A component whose FMU is not known is left out.
    """
    elements: dict[str, dict[str, dict[int, list[Value]]]] = {}
    names = {name: _names(description) for name, description in known.items()}
    for scope, element in structure.scopes:
        for entry in _entries(element, root_units, archive, errors):
            found = structure.parameter(scope, entry.name, errors)
            if found is None or (component := flat_name(found[0])) not in known:
                continue
            parameter = found[1]
            place = ".".join((*found[0], parameter))
            if parameter not in names[component]:
                errors.append(f"parameter {place} is none of {component}; {nearest(parameter, names[component])}")
                continue
            variable, number = names[component][parameter]
            values = _values(entry, known[component].variables[variable], place, errors)
            elements.setdefault(component, {}).setdefault(variable, {})[number] = values
    return {
        component: {name: _joined(known[component], name, parts) for name, parts in parameters.items()}
        for component, parameters in elements.items()
    }


def _names(description: FmuDescription) -> Places:
    """The names of its parameters."""
    settable = description.parameters
    return {name: place for name, place in places(description).items() if place[0] in settable}


def _entries(
    scope: ET.Element, root_units: Mapping[str, str], archive: zipfile.ZipFile, errors: list[str]
) -> Iterator[Entry]:
    """The parameters bound to an element."""
    for binding in scope.findall(f"{SSD}ParameterBindings/{SSD}ParameterBinding"):
        inside, prefix = binding.find(f"{SSD}ParameterValues/{SSV}ParameterSet"), binding.get("prefix", "")
        root = _document(binding, inside, "parameters", f"{SSV}ParameterSet", archive, errors)
        mapping = binding.find(f"{SSD}ParameterMapping")
        lines = None if mapping is None else _mapping(mapping, archive, errors)
        if root is None:
            continue
        units = {**root_units, **units_in(root, SSV, errors)}
        given = {prefix + each.get("name", ""): each for each in root.findall(f"{SSV}Parameters/{SSV}Parameter")}
        errors += [
            f"the mapping of {source} to {ways[0][0]}: its parameter set has no {source}; {nearest(source, given)}"
            for source, ways in (lines or {}).items()
            if source not in given
        ]
        for name, parameter in given.items():
            value = next((child for child in parameter if child.tag.startswith(SSV)), None)
            if value is not None:
                targets = [(name, Way())] if lines is None else lines.get(name, [])
                yield from (Entry(target, value, units, way) for target, way in targets)


def _document(
    holder: ET.Element, inside: ET.Element | None, what: str, tag: str, archive: zipfile.ZipFile, errors: list[str]
) -> ET.Element | None:
    """The root of the file that an element names as its source, else what stands inside it."""
    source = holder.get("source")
    if source is None:
        return inside
    if holder.get("sourceBase") == "component":
        errors.append(f"{what} {source!r} lie in an FMU (sourceBase), which inkloop does not open; move them out")
        return None
    try:
        root = parsed_xml(archive.read(member_of(source)))
    except (KeyError, XmlError) as error:  # without the member, it is a KeyError
        errors.append(f"{what} {source!r} cannot be read: {'the file ' if isinstance(error, XmlError) else ''}{error}")
        return None
    if root.tag != tag:
        errors.append(f"{what} {source!r} are no {tag.rpartition('}')[2]} of SSP, but <{root.tag}>")
        return None
    return root


def _mapping(holder: ET.Element, archive: zipfile.ZipFile, errors: list[str]) -> dict[str, list[tuple[str, Way]]]:
    """Name in a parameter set -> names of parameters that it goes to, and the way there; others go nowhere."""
    inside = holder.find(f"{SSM}ParameterMapping")
    root = _document(holder, inside, "mappings", f"{SSM}ParameterMapping", archive, errors)
    found: dict[str, list[tuple[str, Way]]] = {}
    for entry in root.findall(f"{SSM}MappingEntry") if root is not None else ():
        source, target = entry.get("source", ""), entry.get("target", "")
        line = linear(entry, f"the mapping of {source} to {target}", errors)
        found.setdefault(source, []).append((target, Way(line, converts_units(entry))))
    return found


def _values(entry: Entry, variable: Variable, place: str, errors: list[str]) -> list[Value]:
    text = entry.value.get("value", "")
    texts = [each.get("value", "") for each in entry.value.findall(f"{SSV}Value")]  # of texts and enumerations
    texts = texts or ([text] if variable.items or variable.type == TEXT else text.split())
    conversion = Conversion(1.0)
    unit = entry.value.get("unit")
    if unit and entry.way.converts:
        found = unit_conversion(entry.units.get(unit, unit), variable.unit)
        if found is None:
            errors.append(f"parameter {place} is in [{unit}]; {variable.name} is in [{variable.unit}]")
        conversion = found or conversion
    line = conversion.then(entry.way.line)
    if line != _UNCHANGED and np.dtype(variable.dtype).kind != "f":
        errors.append(f"parameter {place} is {variable.type}; a unit or a transformation needs a real number")
    is_array = bool(variable.dimensions) and not variable.elements
    try:
        values = [_value(text, variable, line) for text in texts]
    except ValueError:
        values = []
    if len(values) == 1 or (values and is_array):
        return values
    errors.append(f"parameter {place} is {' '.join(texts)!r}; expected {variable.type}")
    return [0]


def _value(text: str, variable: Variable, line: Conversion = _UNCHANGED) -> Value:
    kind = np.dtype(variable.dtype).kind
    if variable.type == TEXT:
        return text
    if variable.items:
        number = variable.items.get(text)
        return int(text) if number is None else number if variable.dimensions else text
    if kind == "b":
        if text not in ("true", "false", "1", "0"):
            raise ValueError(text)
        return text in ("true", "1")
    return float(text) * line.factor + line.offset if kind == "f" else int(text)


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
    whole = [parts.get(number, [_value(text, variable)])[0] for number, text in enumerate(starts)]
    return np.asarray(whole).reshape(variable.shape({})).tolist()
