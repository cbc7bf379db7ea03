"""The nested systems of an .ssd taken as one: components by their path, and wires that pass through connectors."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from inkloop.errors import nearest
from inkloop.units import Conversion, defined_unit

_NAMESPACE = "http://ssp-standard.org/SSP1/SystemStructure"
SSC = f"{{{_NAMESPACE}Common}}"
SSD = f"{{{_NAMESPACE}Description}}"
SSV = f"{{{_NAMESPACE}ParameterValues}}"
SSM = f"{{{_NAMESPACE}ParameterMapping}}"
_FMU = "application/x-fmu-sharedlibrary"
_TRANSFORMATIONS = ("BooleanMappingTransformation", "IntegerMappingTransformation", "EnumerationMappingTransformation")
_BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")

Path: TypeAlias = tuple[str, ...]
"""Names of an element and of the systems around it, the outermost left out."""
Node: TypeAlias = tuple[Path, str]
"""An element and the name of its connector."""


def flat_name(path: Path) -> str:
    """The name of a component in a scenario."""
    return "_".join(path)


@dataclass(frozen=True)
class Structure:
    """Components and systems by path, outer ones first; refused: elements that are neither, each with an error."""

    components: Mapping[Path, ET.Element]
    systems: Mapping[Path, ET.Element]
    refused: Collection[Path]

    @classmethod
    def of(cls, system: ET.Element, errors: list[str]) -> Structure:
        """The structure below a system."""
        components: dict[Path, ET.Element] = {}
        systems: dict[Path, ET.Element] = {(): system}
        refused: set[Path] = set()
        waiting: list[Path] = [()]
        while waiting:
            place = waiting.pop(0)
            for element in systems[place].findall(f"{SSD}Elements/*"):
                path = (*place, element.get("name", ""))
                if reason := _refusal(element, path, components):
                    errors.append(f"{'.'.join(path)} {reason}")
                    refused.add(path)
                elif element.tag == f"{SSD}System":
                    systems[path] = element
                    waiting.append(path)
                else:
                    components[path] = element
        if not components and not errors:
            errors.append("its system has no component")
        return cls(components, systems, refused)

    @property
    def scopes(self) -> list[tuple[Path, ET.Element]]:
        """Elements whose parameter bindings count, the inner ones first: an outer system overrides its parts."""
        systems = sorted(self.systems.items(), key=lambda each: -len(each[0]))
        return [*self.components.items(), *systems]

    def parameter(self, scope: Path, name: str, errors: list[str]) -> tuple[Path, str] | None:
        """The component and its parameter that a name means in an element; None with an error in `errors`."""
        path, rest = scope, name
        while path not in self.components:
            head, _, rest = rest.partition(".")
            inner = (*path, head)
            if inner in self.refused:
                return None
            if inner not in self.components and inner not in self.systems:
                advice = (
                    self._behind(path, head) or f"there is no component {head!r}; {nearest(head, self.names(path))}"
                )
                errors.append(f"parameter {'.'.join((*scope, name))}: {advice}")
                return None
            path = inner
        return path, rest

    def _behind(self, system: Path, name: str) -> str | None:
        """The advice on a value for a connector of a system."""
        if self.connector((system, name)) is None:
            return None
        fed = [
            f"{each.get('endElement')}.{each.get('endConnector')}"
            for place, each in self.connections()
            if place == system and each.get("startElement") is None and each.get("startConnector") == name
        ]
        whom = f": name {' and '.join(fed)} in the parameter set" if fed else ""
        return f"{name} is a connector of a system; inkloop takes values for parameters of components{whom}"

    def names(self, system: Path) -> list[str]:
        """Names of the elements of a system."""
        return [path[-1] for path in (*self.components, *self.systems) if path and path[:-1] == system]

    def connections(self) -> Iterator[tuple[Path, ET.Element]]:
        """Each connection with the system that it stands in."""
        for path, system in self.systems.items():
            for connection in system.findall(f"{SSD}Connections/{SSD}Connection"):
                yield path, connection

    def connector(self, node: Node) -> ET.Element | None:
        """The connector of a system."""
        path, name = node
        found = self.systems[path].findall(f"{SSD}Connectors/{SSD}Connector")
        return next((each for each in found if each.get("name") == name), None)


def _refusal(element: ET.Element, path: Path, components: Mapping[Path, ET.Element]) -> str | None:
    kind = element.tag.removeprefix(SSD)
    if kind not in ("Component", "System"):
        return f"is a {kind}; inkloop takes components and systems"
    if not path[-1]:
        return f"is a {kind} without a name; name it"
    if "." in path[-1]:
        return "has a dot in its name, which separates component and port; rename it"
    if kind == "System":
        return None
    if element.get("type", _FMU) != _FMU:
        return f"is of type {element.get('type')!r}; inkloop takes FMUs ({_FMU})"
    if (same := next((other for other in components if flat_name(other) == flat_name(path)), None)) is not None:
        return f"would have the name {flat_name(path)} of {'.'.join(same)} in a scenario; rename one"
    return None


def units_in(root: ET.Element, tag: str, errors: list[str]) -> dict[str, str]:
    """Units that a file defines, by name; tag: the namespace of its root."""
    found = {}
    for unit in root.findall(f"{tag}Units/{SSC}Unit"):
        base = unit.find(f"{SSC}BaseUnit")
        if base is not None:
            name = unit.get("name", "")
            try:
                exponents = {each: int(base.get(each, "0")) for each in _BASE_UNITS}
                factor, offset = float(base.get("factor", "1")), float(base.get("offset", "0"))
                found[name] = defined_unit(name, exponents, factor, offset)
            except ValueError as error:
                errors.append(f"unit {name!r} is no unit: {error}")
    return found


def converts_units(element: ET.Element) -> bool:
    """Whether a connection or a mapping converts units before its transformation."""
    return element.get("suppressUnitConversion") not in ("true", "1")


def linear(element: ET.Element, place: str, errors: list[str]) -> Conversion:
    """The linear transformation of a connection or a mapping; an error once for all elements of an array."""
    wrong = [f"{place} has a {tag}; inkloop takes LinearTransformation only" for tag in _TRANSFORMATIONS
             if element.find(f"{SSC}{tag}") is not None]  # fmt: skip
    line = element.find(f"{SSC}LinearTransformation")
    factor, offset = ("1", "0") if line is None else (line.get("factor", "1"), line.get("offset", "0"))
    try:
        found = Conversion(float(factor), float(offset))
    except ValueError:
        found = Conversion(1.0)
        wrong.append(f"{place}: factor {factor!r}, offset {offset!r}; expected numbers")
    errors += [error for error in wrong if error not in errors]
    return found
