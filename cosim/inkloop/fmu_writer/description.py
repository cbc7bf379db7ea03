"""modelDescription.xml of FMI 2 and FMI 3 for any grid, written from a model's definition."""

from __future__ import annotations

import itertools
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

from inkloop.fmu_writer.definition import WITHOUT_NUMBER, ModelDefinition, VariableDefinition
from inkloop.units import BASE_UNITS, si_unit

_DISPLAY_UNITS = {"1/m": "1/um", "m": "um", "m3": "um3", "rad": "deg", "s": "ms"}
_NOMINALS = {"1/m": "1e4", "m": "1e-6", "m3": "1e-15"}
"""Unit -> typical value, for tolerances: a gain by height, the height of a layer, the volume of a droplet."""
_FMI2_TYPES = {
    "real": "Real",
    "integer": "Integer",
    "boolean": "Boolean",
    "enumeration": "Enumeration",
    "count": "Integer",
}
_FMI3_TYPES = {
    "real": "Float64",
    "integer": "Int32",
    "boolean": "Boolean",
    "enumeration": "Enumeration",
    "count": "UInt64",
    "clock": "Clock",
    "string": "String",
    "binary": "Binary",
}
Starts: TypeAlias = Mapping[str, float | Sequence[float]]
"""Start values by name, of a map one for all cells or each."""
_LOG_CATEGORIES = {
    "logStatusDiscard": "Values and commands that were refused",
    "logStatusError": "Calls that were not allowed",
}


@dataclass(frozen=True)
class Release:
    """Generation tool and date of a description; `date` in the form 2026-01-31T12:00:00Z."""

    version: str
    date: str


@dataclass(frozen=True)
class Baked:
    """Changes of an FMU's description by its resources: start values (texts: of strings), and its own texts.

    mark: see `ModelDefinition.token`; None: as in the model.
    """

    starts: Starts = field(default_factory=dict)
    texts: Mapping[str, str] = field(default_factory=dict)
    mark: str = ""
    description: str | None = None
    step_size: float | None = None
    stop_time: float | None = None


PLAIN = Baked()
"""Description of an FMU without resources."""


def write(
    model: ModelDefinition,
    form: str,
    sizes: Mapping[str, int],
    sources: Sequence[str],
    release: Release,
    baked: Baked = PLAIN,
) -> bytes:
    """modelDescription.xml of one of the `FORMS` of this package.

    sizes: values of structural parameters, in place of their start values; sources: the C files that make the binary.
    """
    given = {name: getattr(baked, name) for name in ("description", "step_size", "stop_time")}
    model = replace(model, **{name: value for name, value in given.items() if value is not None})
    starts = {**baked.starts, **model.sizes(sizes)}
    if form == "fmi2":
        token = model.token(model.sizes(starts), resizable=False, mark=baked.mark)
        return to_bytes(_fmi2(model, starts, token, sources, release))
    is_fixed = form == "fmi3-fixed"
    token = model.token(model.sizes(starts), resizable=not is_fixed, mark=baked.mark)
    return to_bytes(_fmi3(model, starts, token, release, baked, is_fixed=is_fixed))


def to_bytes(root: ET.Element) -> bytes:
    """The document, indented, as UTF-8."""
    ET.indent(root)
    text: bytes = ET.tostring(root, encoding="UTF-8", xml_declaration=True)
    return text + b"\n"


def add(parent: ET.Element, tag: str, /, **attributes: object) -> ET.Element:
    """A child element; attributes that are None are left out."""
    return ET.SubElement(parent, tag, _texts(attributes))


def _fmi3(
    model: ModelDefinition, starts: Starts, token: str, release: Release, baked: Baked, *, is_fixed: bool
) -> ET.Element:
    sizes = model.sizes(starts)
    root = _root(model, release, fmiVersion="3.0", instantiationToken=token)
    add(
        root,
        "CoSimulation",
        modelIdentifier=model.name,
        canHandleVariableCommunicationStepSize=True,
        canGetAndSetFMUState=True,
        canSerializeFMUState=True,
        hasEventMode=model.has_events,
    )
    _add_units(root, model)
    if model.types:
        types = add(root, "TypeDefinitions")
        for name, enumeration in model.types.items():
            element = add(types, "EnumerationType", name=name)  # FMPy 0.3.20 takes no description
            for item, number in enumeration.items.items():
                add(element, "Item", name=item, value=number)
    _add_experiment(root, model)
    variables = add(root, "ModelVariables")
    references = {variable.name: number for number, variable in enumerate(model.exposed)}
    for v in model.exposed:
        sized = starts.get(v.name, v.start)
        start = _start(v, sized, v.count(sizes))
        rest = {**_roles(v, is_fixed), **_type_attributes(v), "start": start}
        named = {"name": v.name, "valueReference": references[v.name], "description": v.description}
        clocks = references[v.clock] if v.clock else None
        element = add(variables, _FMI3_TYPES[v.type], **named, clocks=clocks, **rest)
        if v.type in ("string", "binary") and v.causality != "output":
            add(element, "Start", value=baked.texts.get(v.name, ""))
        for axis in v.dimensions:
            add(element, "Dimension", **({"start": sizes[axis]} if is_fixed else {"valueReference": references[axis]}))
    structure = add(root, "ModelStructure")
    for tag in ("Output", "InitialUnknown"):
        for v in model.exposed:
            if v.causality == "output" and not (tag == "InitialUnknown" and v.clock):
                known = str(references[v.initial_from]) if v.initial_from and tag == "InitialUnknown" else ""
                add(structure, tag, valueReference=references[v.name], dependencies=known)
    return root


def _fmi2(model: ModelDefinition, starts: Starts, guid: str, sources: Sequence[str], release: Release) -> ET.Element:
    sizes = model.sizes(starts)
    root = _root(model, release, fmiVersion="2.0", guid=guid)
    interface = add(
        root,
        "CoSimulation",
        modelIdentifier=model.name,
        canHandleVariableCommunicationStepSize=True,
        canNotUseMemoryManagementFunctions=True,
        canGetAndSetFMUstate=True,
        canSerializeFMUstate=True,
    )
    files = add(interface, "SourceFiles")
    for source in sources:
        add(files, "File", name=source)
    _add_units(root, model)
    if model.types:
        types = add(root, "TypeDefinitions")
        for name, enumeration in model.types.items():
            simple = add(types, "SimpleType", name=name, description=enumeration.description)
            element = add(simple, "Enumeration")
            for item, number in enumeration.items.items():
                add(element, "Item", name=item, value=number)
    _add_experiment(root, model)
    variables = add(root, "ModelVariables")
    for v, first in model.scalar_references(sizes):
        if v.causality == "independent":
            continue  # optional in FMI 2, and FMI Library takes it for a fault
        sized = starts.get(v.name, v.start)
        for offset, name in enumerate(_scalar_names(v, sizes)):
            named = {"name": name, "valueReference": first + offset, "description": v.description}
            scalar = add(variables, "ScalarVariable", **named, **_roles(v, True))
            add(scalar, _FMI2_TYPES[v.type], **_type_attributes(v), start=_start(v, sized, 1))
    structure = add(root, "ModelStructure")
    outputs, unknowns = add(structure, "Outputs"), add(structure, "InitialUnknowns")
    for index, dependencies in _fmi2_outputs(model, sizes):
        add(outputs, "Unknown", index=index, dependencies="")
        add(unknowns, "Unknown", index=index, dependencies=dependencies)
    return root


def _fmi2_outputs(model: ModelDefinition, sizes: Mapping[str, int]) -> Iterator[tuple[int, str]]:
    """Index of each scalar output and the indices that its value at the start depends on.

    An index counts the variables from 1; it is the value reference, because time, reference 0, is not listed.
    """
    firsts = {v.name: (v, reference) for v, reference in model.scalar_references(sizes)}
    for v, first in firsts.values():
        if v.causality != "output":
            continue
        for offset in range(v.count(sizes)):
            dependencies = ""
            if v.initial_from:
                known, known_first = firsts[v.initial_from]
                whole = range(known_first, known_first + known.count(sizes))
                dependencies = str(whole[offset]) if v.is_grid and known.is_grid else " ".join(map(str, whole))
            yield first + offset, dependencies


def _root(model: ModelDefinition, release: Release, **version_attributes: str) -> ET.Element:
    attributes = {
        "modelName": model.name,
        **version_attributes,
        "description": model.description,
        "author": "inkloop",
        "version": release.version,
        "copyright": "Copyright (c) the inkloop authors",
        "license": "BSD-3-Clause",
        "generationTool": f"inkloop {release.version}",
        "generationDateAndTime": release.date,
        "variableNamingConvention": "structured",
    }
    return ET.Element("fmiModelDescription", _texts(dict(attributes)))


def _add_units(root: ET.Element, model: ModelDefinition) -> None:
    definitions = add(root, "UnitDefinitions")
    for unit in sorted({v.unit for v in model.exposed} - {"1"}):
        element = add(definitions, "Unit", name=unit)
        add(element, "BaseUnit", **BASE_UNITS[unit])
        _, to_si = si_unit(_DISPLAY_UNITS[unit])
        add(element, "DisplayUnit", name=_DISPLAY_UNITS[unit], factor=f"{1.0 / to_si:.15g}")


def _add_experiment(root: ET.Element, model: ModelDefinition) -> None:
    categories = add(root, "LogCategories")
    for name, description in _LOG_CATEGORIES.items():
        add(categories, "Category", name=name, description=description)
    add(root, "DefaultExperiment", startTime=0.0, stopTime=model.stop_time, stepSize=model.step_size)


def _roles(variable: VariableDefinition, is_fixed: bool) -> dict[str, str]:
    """Causality, variability and initial in the standard's words."""
    match variable.causality:
        case "independent":
            return {"causality": "independent", "variability": "continuous"}
        case "structural" if is_fixed:
            return {"causality": "local", "variability": "constant", "initial": "exact"}
        case "structural":
            return {"causality": "structuralParameter", "variability": "fixed"}
        case "parameter":
            return {"causality": "parameter", "variability": "tunable" if variable.is_tunable else "fixed"}
        case "output" if variable.type == "clock":
            return {"causality": "output"}
        case "output":
            return {"causality": "output", "variability": "discrete", "initial": "calculated"}
        case _:
            return {"causality": "input", "variability": "discrete"}


def _type_attributes(variable: VariableDefinition) -> dict[str, object]:
    if variable.declared is not None:
        return {"declaredType": variable.declared}
    match variable.type:
        case "clock":
            return {"intervalVariability": "triggered"}
        case "binary":
            return {"mimeType": variable.mime_type, "maxSize": variable.max}
        case "string":
            return {}
    has_unit = variable.unit != "1"
    return {
        "unit": variable.unit if has_unit else None,
        "displayUnit": _DISPLAY_UNITS[variable.unit] if has_unit else None,
        "nominal": _NOMINALS.get(variable.unit),
        "min": None if variable.min is None else _number(variable, variable.min),
        "max": None if variable.max is None else _number(variable, variable.max),
    }


def _start(variable: VariableDefinition, value: float | Sequence[float], count: int) -> str | None:
    if variable.causality in ("independent", "output") or variable.type in WITHOUT_NUMBER:
        return None
    values = [value] * count if isinstance(value, int | float) else value
    return " ".join(_number(variable, each) for each in values)


def _number(variable: VariableDefinition, value: float) -> str:
    if variable.type == "boolean":
        return "true" if value else "false"
    return repr(float(value)) if variable.type == "real" else str(int(value))


def _scalar_names(variable: VariableDefinition, sizes: Mapping[str, int]) -> Iterator[str]:
    if not variable.is_grid:
        yield variable.name
        return
    for index in itertools.product(*(range(1, size + 1) for size in variable.shape_for(sizes))):
        yield f"{variable.name}[{','.join(map(str, index))}]"


def _texts(attributes: dict[str, object]) -> dict[str, str]:
    texts = {True: "true", False: "false"}
    return {
        name: texts[value] if isinstance(value, bool) else str(value)
        for name, value in attributes.items()
        if value is not None
    }
