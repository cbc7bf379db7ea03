"""Read modelDescription.xml through FMPy's parser, also of FMUs in an .ssp: `system.ssp/resources/plant.fmu`.

The structured scalars of FMI 2 (`height[1,1]`, `height[1,2]`, ...) become one variable `height` of shape (nx, ny) if
none is missing and all agree in type, causality, variability, unit and limits; names that follow no convention ("flat")
stay as they are. The dimensions of an FMI 3 array keep the names of the structural parameters that set them.
"""

from __future__ import annotations

import itertools
import math
import re
import zipfile
import zlib
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from inkloop.errors import FmuError
from inkloop.files import reason_of, regular, temporary_folder
from inkloop.fmu.bus_terminals import read_buses
from inkloop.fmu.description import FmuDescription
from inkloop.fmu.variable import DTYPES, TEXT, Variable
from inkloop.limits import check_xml, memory_error, size_text, unpacked_error
from inkloop.units import Conversion, defined_unit, unit_conversion

PARSED_BYTES = 18
"""Memory that reading takes per byte of a description: 3.0 GiB for the 184 MB of an FMI 2 grid of 400 x 400 cells."""
_ELEMENT = re.compile(r"(?P<name>.+)\[(?P<index>-?\d+(?:,-?\d+)*)\]")
_DESCRIPTIONS = {"modelDescription.xml", "sources/buildDescription.xml"}
"""XML that FMPy reads."""
_SHOWN = ("input", "output", "parameter", "structuralParameter")


def describe(path: Path | str) -> FmuDescription:
    """The description of an FMU. Raises FmuError if it cannot be read or is not for co-simulation."""
    path = Path(path)
    try:
        return _describe(path, regular(path).stat().st_mtime_ns)
    except OSError as error:
        raise FmuError(f"{path}: cannot be read: {error.strerror}") from error


@lru_cache(maxsize=32)
def _describe(path: Path, changed_ns: int) -> FmuDescription:
    from fmpy import read_model_description

    try:
        with zipfile.ZipFile(path) as archive:
            names = [name.split("/") for name in archive.namelist()]
            if any("\\" in name for name in archive.namelist()):
                raise FmuError(f"{path}: its members are named with backslashes; pack it again, with / in the names")
            if reason := unpacked_error(archive) or _description_error(archive):
                raise FmuError(f"{path}: {reason}")
            for member in {*archive.namelist()} & _DESCRIPTIONS:
                with archive.open(member) as file:
                    check_xml(file)
            model = read_model_description(str(path), validate=False)
            has_offset = any(unit.baseUnit is not None and unit.baseUnit.offset for unit in model.unitDefinitions)
            differences = _differences(archive) if has_offset else frozenset[str]()
            buses = read_buses(archive, model)
    except (OSError, FmuError):
        raise
    except zipfile.BadZipFile as error:
        found = f"{path}: is not a readable FMU: {error}"
        raise FmuError(f"{found}; name an .fmu file, or export or copy it again") from error
    except Exception as error:  # the parser raises bare exceptions
        is_reference = isinstance(error, KeyError) and str(error).isdecimal()
        reason = f"no variable has the valueReference {error}" if is_reference else str(error).strip("\"'")
        raise FmuError(f"{path}: is not a readable FMU: {reason}") from error
    if model.fmiVersion[:1] not in ("2", "3"):
        raise FmuError(f"{path}: is FMI {model.fmiVersion}; inkloop takes FMI 2 and FMI 3")
    if model.coSimulation is None:
        offered = "model exchange" if model.modelExchange is not None else "scheduled execution"
        raise FmuError(f"{path}: offers {offered} only; export it for co-simulation")
    platforms = sorted({parts[1] for parts in names if parts[0] == "binaries" and len(parts) > 2})
    described = _translated(path, model, tuple(platforms), differences)
    served = {reference for bus in buses.get("buses", ()) for reference in bus.references}
    on_buses = {v.name for v in model.modelVariables if v.valueReference in served}
    unused = {name: kind for name, kind in described.unused.items() if name not in on_buses}
    return replace(described, unused=unused, **buses)


def _description_error(archive: zipfile.ZipFile) -> str | None:
    """The reason why a modelDescription.xml is not read; KeyError without one."""
    size = archive.getinfo("modelDescription.xml").file_size
    reason = memory_error(size * PARSED_BYTES)
    return reason and f"its modelDescription.xml of {size_text(size)} {reason}; export it as FMI 3, or a smaller grid"


def _translated(path: Path, model: Any, platforms: tuple[str, ...], differences: Container[str]) -> FmuDescription:
    """Translate the parsed modelDescription.xml of a co-simulation FMU. Raises FmuError."""
    fmi, identifier = int(model.fmiVersion[0]), model.coSimulation.modelIdentifier
    if not re.fullmatch(r"[A-Za-z_]\w*", identifier, re.ASCII):  # it names the file of the library
        raise FmuError(
            f"{path}: its modelIdentifier is {identifier!r}; FMI takes letters, digits and _; export it again"
        )
    lengths = {v.valueReference: _length(v) for v in model.modelVariables}
    units = {unit.name: unit for unit in model.unitDefinitions}
    try:
        exchanged = [_variable(v, lengths, units, differences) for v in model.modelVariables if _is_exchanged(v)]
    except ValueError as error:
        raise FmuError(f"{path}: {error}") from error
    notes: list[str] = []
    if fmi == 2 and model.variableNamingConvention == "structured":
        exchanged, notes = _joined(exchanged)
    if fault := _fault(exchanged):
        raise FmuError(f"{path}: {fault}; export it again, or ask who made it")
    return FmuDescription(
        path=path,
        name=model.modelName,
        fmi=fmi,
        identifier=identifier,
        token=model.guid,
        variables={variable.name: variable for variable in exchanged},
        unused={v.name: _kind(v) for v in model.modelVariables if v.causality in _SHOWN and not _is_exchanged(v)},
        notes=tuple(notes),
        platforms=platforms,
        is_single=bool(model.coSimulation.canBeInstantiatedOnlyOncePerProcess),
        needs_tool=bool(model.coSimulation.needsExecutionTool),
        can_serialize=bool(model.coSimulation.canSerializeFMUstate),
        needs_events=bool(getattr(model.coSimulation, "hasEventMode", False))
        and any(v.type == "Clock" for v in model.modelVariables),
        can_vary_step=bool(model.coSimulation.canHandleVariableCommunicationStepSize),
        description=model.description or "",
        version=model.version or "",
        license=model.license or "",
        tool=model.generationTool or "",
    )


def _fault(variables: Sequence[Variable]) -> str | None:
    """The first of what makes no sense in variables: no name, one that two have, a start that is no number."""
    known: dict[str, Variable] = {}
    sizes: dict[str, int] = {}
    for variable in sorted(variables, key=lambda each: bool(each.dimensions)):  # sizes first
        if not variable.name:
            return "a variable has no name"
        if variable.name in known:
            return f"two variables are called {variable.name!r}"
        known[variable.name] = variable
        if fault := variable.fault(sizes):
            return f"{variable.name} {fault}"
        if variable.is_size and variable.start:
            sizes[variable.name] = int(variable.start[0])
    return None


def _differences(archive: zipfile.ZipFile) -> frozenset[str]:
    """Names of the variables that are differences (relativeQuantity), which FMPy 0.3.32 does not read."""
    found, name = set(), ""
    with archive.open("modelDescription.xml") as file:
        for _, element in ElementTree.iterparse(file, ["start"]):
            name = element.get("name", name)
            if element.get("relativeQuantity") in ("true", "1"):
                found.add(name)
    return frozenset(found)


def _is_exchanged(found: Any) -> bool:
    """Whether the master exchanges a variable: numbers and truth values, texts only as parameters, none with a
    clock.
    """
    is_text_parameter = found.type == TEXT and found.causality == "parameter" and not found.dimensions
    return (found.type in DTYPES and found.type != TEXT and not found.clocks) or is_text_parameter


def _kind(found: Any) -> str:
    """The kind of a variable that is not exchanged."""
    clocks = [clock.name for clock in found.clocks or ()]
    return f"{found.type} {found.causality}" + (f", at ticks of {', '.join(clocks)}" if clocks else "")


def _unit(found: Any, is_difference: bool) -> str:
    """A unit by the FMU's own UnitDefinitions, which decide the meaning of its name; no offset for differences."""
    if found.baseUnit is None:
        return str(found.name)
    base = found.baseUnit
    exponents = {name: getattr(base, name) for name in ("kg", "m", "s", "A", "K", "mol", "cd", "rad")}
    return defined_unit(found.name, exponents, base.factor, 0.0 if is_difference else base.offset)


def _length(found: Any) -> int | str:
    """A variable as the length of a dimension: the value of a constant, the name of any other."""
    is_constant = found.variability == "constant" and str(found.start or "").isdecimal()
    return int(found.start) if is_constant else str(found.name)


def _variable(
    found: Any, lengths: Mapping[int, int | str], units: Mapping[str, Any], differences: Container[str]
) -> Variable:
    declared = found.declaredType
    items = declared.items if declared is not None and found.type == "Enumeration" else ()
    unit = found.unit or (declared.unit if declared is not None else None) or "1"
    is_difference = found.name in differences or (declared is not None and declared.relativeQuantity)
    start = found.start or ""
    return Variable(
        name=found.name,
        type=found.type,
        causality=found.causality,
        variability=found.variability,
        references=(found.valueReference,),
        dimensions=tuple(lengths[d.valueReference] if d.start is None else int(d.start) for d in found.dimensions),
        unit=_unit(units[unit], is_difference) if unit in units else unit,
        start=(start,) if found.type == TEXT else tuple(start.split()),
        minimum=found.min if found.min is not None or declared is None else declared.min,
        maximum=found.max if found.max is not None or declared is None else declared.max,
        items={item.name: int(item.value) for item in items},
        description=found.description or "",
    )


def _joined(scalars: Sequence[Variable]) -> tuple[list[Variable], list[str]]:
    """Structured scalars joined to arrays, everything else as it is; and a note on each name that is not joined."""
    arrays: dict[str, dict[tuple[int, ...], Variable]] = {}
    for variable in scalars:
        if match := _ELEMENT.fullmatch(variable.name):
            index = tuple(int(part) for part in match["index"].split(","))
            arrays.setdefault(match["name"], {})[index] = variable
    names = {variable.name for variable in scalars}
    found: list[Variable] = []
    notes: list[str] = []
    joined: set[str] = set()
    for name, elements in arrays.items():
        reason = f"there is a variable {name}" if name in names else _difference(name, elements)
        if reason:
            if any(element.causality in _SHOWN for element in elements.values()):
                notes.append(f"the elements of {name} stay single variables: {reason}")
        else:
            found.append(_join(name, elements))
            joined.update(element.name for element in elements.values())
    return [variable for variable in scalars if variable.name not in joined] + found, notes


def _difference(name: str, elements: Mapping[tuple[int, ...], Variable]) -> str | None:
    """The reason why elements are no array: some are missing, or two of them differ."""
    if len({len(index) for index in elements}) > 1:
        return "they have different numbers of indices"
    if any(number < 0 for index in elements for number in index):
        return "they have indices below 0"
    begin, shape = _extent(elements)
    if len(elements) != math.prod(shape):
        missing = next(index for index in _indices(begin, shape) if index not in elements)
        return f"{name}[{','.join(map(str, missing))}] is missing"
    first = next(iter(elements.values()))
    for element in elements.values():
        for what in ("type", "causality", "variability", "unit", "items", "minimum", "maximum"):
            if getattr(element, what) != getattr(first, what):
                one, other = (f"{each.name} has {what} {_shown(getattr(each, what))}" for each in (first, element))
                return f"{one}, {other}"
        if unit_conversion(first.unit, element.unit) != Conversion(1.0):
            return f"one of {first.name} and {element.name} is a difference (relativeQuantity)"
    return None


def _indices(begin: Sequence[int], shape: Sequence[int]) -> Iterator[tuple[int, ...]]:
    """The indices of an array one by one, however long it is."""
    for number in itertools.count():
        index: list[int] = []
        for first, length in zip(reversed(begin), reversed(shape), strict=True):
            number, along = divmod(number, length)
            index.insert(0, first + along)
        yield tuple(index)


def _shown(value: object) -> str:
    if isinstance(value, Mapping):
        return ", ".join(value) or "none"
    return "none" if value is None else str(value)


def _extent(elements: Iterable[tuple[int, ...]]) -> tuple[list[int], tuple[int, ...]]:
    """First index, 0 or 1, and length along each dimension."""
    along = list(zip(*elements, strict=True))
    begin = [0 if 0 in indices else 1 for indices in along]  # some exporters count from 0
    return begin, tuple(max(indices) - first + 1 for indices, first in zip(along, begin, strict=True))


def _join(name: str, elements: Mapping[tuple[int, ...], Variable]) -> Variable:
    _, shape = _extent(elements)
    ordered = [elements[index] for index in sorted(elements)]
    has_start = any(element.start for element in ordered)
    return replace(
        ordered[0],
        name=name,
        references=tuple(element.references[0] for element in ordered),
        elements=tuple(element.name for element in ordered),
        dimensions=shape,
        start=tuple(text for element in ordered for text in element.start or ("0",)) if has_start else (),
    )


SUFFIX = ".ssp"
UNREADABLE = (OSError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error)
"""Errors of reading a damaged or encrypted archive; NotImplementedError is a RuntimeError."""


@contextmanager
def fmu_file(path: Path) -> Iterator[Path]:
    """The file that `path` names, a copy of it where that leads into an .ssp. Raises FmuError, by `path`."""
    archive = next((folder for folder in path.parents if folder.suffix == SUFFIX and folder.is_file()), None)
    if archive is None:
        yield path
        return
    with temporary_folder("ssp") as folder:
        copy = folder / path.name
        try:
            with zipfile.ZipFile(archive) as packed:
                if reason := unpacked_error(packed):
                    raise FmuError(f"{archive}: {reason}")
                copy.write_bytes(packed.read(path.relative_to(archive).as_posix()))
        except (KeyError, *UNREADABLE) as error:
            cause = reason_of(error) if isinstance(error, OSError) else str(error)
            raise FmuError(f"{path}: cannot be read: {cause}") from error
        try:
            yield copy
        except FmuError as error:
            raise FmuError(str(error).replace(str(copy), str(path))) from error
