"""Read modelDescription.xml through FMPy's parser, also of FMUs in an .ssp: `system.ssp/resources/plant.fmu`.

The structured scalars of FMI 2 (`height[1,1]`, `height[1,2]`, ...) become one variable `height` of shape (nx, ny), and
the dimensions of an FMI 3 array keep the names of the structural parameters that set them.
"""

from __future__ import annotations

import re
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from inkloop.errors import FmuError
from inkloop.files import reason_of, temporary_folder
from inkloop.fmu.description import FmuDescription
from inkloop.fmu.variable import DTYPES, Variable
from inkloop.limits import memory_error, size_text, unpacked_error
from inkloop.units import defined_unit

PARSED_BYTES = 18
"""Memory that reading takes per byte of a description: 3.0 GiB for the 184 MB of an FMI 2 grid of 400 x 400 cells."""
_ELEMENT = re.compile(r"(?P<name>.+)\[(?P<index>\d+(?:,\d+)*)\]")


def describe(path: Path | str) -> FmuDescription:
    """The description of an FMU. Raises FmuError if it cannot be read or is not for co-simulation."""
    path = Path(path)
    try:
        return _describe(path, path.stat().st_mtime_ns)
    except OSError as error:
        raise FmuError(f"{path}: cannot be read: {error.strerror}") from error


@lru_cache(maxsize=32)
def _describe(path: Path, changed_ns: int) -> FmuDescription:
    from fmpy import read_model_description

    try:
        with zipfile.ZipFile(path) as archive:
            names = [name.split("/") for name in archive.namelist()]
            if reason := unpacked_error(archive) or _description_error(archive):
                raise FmuError(f"{path}: {reason}")
        model = read_model_description(str(path), validate=False)
    except (OSError, FmuError):
        raise
    except zipfile.BadZipFile as error:
        found = f"{path}: is not a readable FMU: {error}"
        raise FmuError(f"{found}; name an .fmu file, or export or copy it again") from error
    except Exception as error:  # the parser raises bare exceptions
        raise FmuError(f"{path}: is not a readable FMU: {error}") from error
    if model.fmiVersion[:1] not in ("2", "3"):
        raise FmuError(f"{path}: is FMI {model.fmiVersion}; inkloop takes FMI 2 and FMI 3")
    if model.coSimulation is None:
        offered = "model exchange" if model.modelExchange is not None else "scheduled execution"
        raise FmuError(f"{path}: offers {offered} only; export it for co-simulation")
    platforms = sorted({parts[1] for parts in names if parts[0] == "binaries" and len(parts) > 2})
    return _translated(path, model, tuple(platforms))


def _description_error(archive: zipfile.ZipFile) -> str | None:
    """The reason why a modelDescription.xml is not read; KeyError without one."""
    size = archive.getinfo("modelDescription.xml").file_size
    reason = memory_error(size * PARSED_BYTES)
    return reason and f"its modelDescription.xml of {size_text(size)} {reason}; export it as FMI 3, or a smaller grid"


def _translated(path: Path, model: Any, platforms: tuple[str, ...]) -> FmuDescription:
    """Translate the parsed modelDescription.xml of a co-simulation FMU. Raises FmuError."""
    fmi = int(model.fmiVersion[0])
    by_reference = {v.valueReference: v.name for v in model.modelVariables}
    units = {unit.name: _unit(unit) for unit in model.unitDefinitions}
    plain = (_variable(v, by_reference, units) for v in model.modelVariables if v.type in DTYPES)
    return FmuDescription(
        path=path,
        name=model.modelName,
        fmi=fmi,
        identifier=model.coSimulation.modelIdentifier,
        token=model.guid,
        variables={v.name: v for v in (_joined(path, plain) if fmi == 2 else plain)},
        platforms=platforms,
        can_serialize=bool(model.coSimulation.canSerializeFMUstate),
        can_vary_step=bool(model.coSimulation.canHandleVariableCommunicationStepSize),
        description=model.description or "",
        version=model.version or "",
        license=model.license or "",
        tool=model.generationTool or "",
    )


def _unit(found: Any) -> str:
    """A unit by the FMU's own UnitDefinitions, which decide the meaning of its name."""
    if found.baseUnit is None:
        return str(found.name)
    base = found.baseUnit
    exponents = {name: getattr(base, name) for name in ("kg", "m", "s", "A", "K", "mol", "cd", "rad")}
    return defined_unit(found.name, exponents, base.factor, base.offset)


def _variable(found: Any, by_reference: Mapping[int, str], units: Mapping[str, str]) -> Variable:
    declared = found.declaredType
    items = declared.items if declared is not None and found.type == "Enumeration" else ()
    unit = found.unit or (declared.unit if declared is not None else None) or "1"
    return Variable(
        name=found.name,
        type=found.type,
        causality=found.causality,
        variability=found.variability,
        references=(found.valueReference,),
        dimensions=tuple(by_reference[d.valueReference] if d.start is None else int(d.start) for d in found.dimensions),
        unit=units.get(unit, unit),
        start=tuple((found.start or "").split()),
        minimum=found.min if found.min is not None or declared is None else declared.min,
        maximum=found.max if found.max is not None or declared is None else declared.max,
        items={item.name: int(item.value) for item in items},
        description=found.description or "",
    )


def _joined(path: Path, scalars: Iterable[Variable]) -> Iterator[Variable]:
    """Structured scalars joined to arrays; everything else as it is."""
    arrays: dict[str, dict[tuple[int, ...], Variable]] = {}
    for variable in scalars:
        if match := _ELEMENT.fullmatch(variable.name):
            index = tuple(int(part) for part in match["index"].split(","))
            arrays.setdefault(match["name"], {})[index] = variable
        else:
            yield variable
    for name, elements in arrays.items():
        yield _join(path, name, elements)


def _join(path: Path, name: str, elements: Mapping[tuple[int, ...], Variable]) -> Variable:
    along = list(zip(*elements, strict=False))
    begin = [0 if 0 in indices else 1 for indices in along]  # some exporters count from 0
    shape = tuple(max(indices) - first + 1 for indices, first in zip(along, begin, strict=True))
    order = [tuple(int(i) + first for i, first in zip(index, begin, strict=True)) for index in np.ndindex(shape)]
    missing = [index for index in order if index not in elements]
    if missing or len(order) != len(elements):
        what = f"{name}[{','.join(map(str, missing[0]))}] is missing" if missing else "they have different dimensions"
        raise FmuError(f"{path}: the elements of {name} do not make an array of {' x '.join(map(str, shape))}: {what}")
    first = elements[order[0]]
    has_start = any(element.start for element in elements.values())
    return Variable(
        name=name,
        type=first.type,
        causality=first.causality,
        variability=first.variability,
        references=tuple(elements[index].references[0] for index in order),
        elements=tuple(elements[index].name for index in order),
        dimensions=shape,
        unit=first.unit,
        start=tuple(text for index in order for text in elements[index].start or ("0",)) if has_start else (),
        minimum=first.minimum,
        maximum=first.maximum,
        items=first.items,
        description=first.description,
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
