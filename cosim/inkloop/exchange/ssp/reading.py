"""Run a system of others in our master: an .ssp laid over a scenario.

The scenario adds what an .ssd cannot express: the part, the run, components that are no FMU. An .ssp written by inkloop
contains it; for any other it is named with it. The FMUs, parameters and connections of the .ssp replace those that the
scenario gives for components of the same names; a parameter that no set of the .ssp names stays as the FMU begins.
"""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from inkloop.components.fmu_parameters import FILE_KEYS, JOB_PARAMETERS
from inkloop.errors import FmuError, ScenarioError, nearest
from inkloop.exchange.ssp import contents, wires
from inkloop.exchange.ssp.contents import member_of
from inkloop.exchange.ssp.ssd import SCENARIO, STRUCTURE
from inkloop.exchange.ssp.structure import SSD, Structure, flat_name, units_in
from inkloop.files import regular
from inkloop.fmu import FmuDescription, describe
from inkloop.fmu.reading import SUFFIX, UNREADABLE, fmu_file
from inkloop.limits import XmlError, parsed_xml, unpacked_error
from inkloop.scenario.file import Scenario
from inkloop.scenario.overrides import apply_overrides
from inkloop.tables.messages import scaled
from inkloop.units import declared_key

__all__ = ["SUFFIX", "scenario_of"]


def scenario_of(path: Path, overrides: Mapping[str, Any] | None = None, job: Path | None = None) -> Scenario:
    """The scenario of an .ssp; job: the scenario file that it is laid over, default the one in it.

    Raises ScenarioError with all errors of the .ssp, or else of the scenario.
    """
    errors: list[str] = []
    try:
        with zipfile.ZipFile(regular(path)) as archive:
            if reason := unpacked_error(archive):
                raise ScenarioError(str(path), [reason])
            text = _text_of_job(archive, job, errors)
            root = _parsed(archive, STRUCTURE, errors)
            if root is None or errors:
                raise ScenarioError(str(path), errors)
            system = root.find(f"{SSD}System")
            if system is None:
                raise ScenarioError(str(path), [f"{STRUCTURE} has no System"])
            structure, units = Structure.of(system, errors), units_in(root, SSD, errors)
            sources = _sources(structure, archive, errors)
            known = _described(path, sources, errors)
            values = contents.parameters(structure, units, archive, known, errors)
            errors += _reserved(values)
    except OSError as error:
        raise ScenarioError(str(path), [f"cannot be read: {error.strerror}"]) from error
    except UNREADABLE as error:
        raise ScenarioError(str(path), [f"is no .ssp, or a damaged one: {error}"]) from error
    connections = wires.connections(structure, units, known, errors)
    if errors := errors or _grid_errors(known, text, overrides or {}, job):
        raise ScenarioError(str(path), errors)
    source = job or path
    place = Path(os.path.relpath(path.resolve(), source.resolve().parent))
    components = {
        name: {
            "kind": "Fmu",
            "file": (place / member).as_posix(),
            JOB_PARAMETERS: False,
            **_options(known[name], values.get(name, {})),
        }
        for name, member in sources.items()
    }
    return Scenario.of_text(_laid_over(text, components, connections), str(source), overrides)


def _text_of_job(archive: zipfile.ZipFile, job: Path | None, errors: list[str]) -> str:
    if job is not None:
        try:
            return regular(job).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            errors.append(f"{job} cannot be read: {error}")
            return ""
    if SCENARIO in archive.namelist():
        return archive.read(SCENARIO).decode("utf-8", "replace")
    errors.append(f"holds no scenario ({SCENARIO}), which defines the part; name a scenario with --job FILE")
    return ""


def _parsed(archive: zipfile.ZipFile, member: str, errors: list[str]) -> ET.Element | None:
    if member not in archive.namelist():
        errors.append(f"holds no {member}")
        return None
    try:
        return parsed_xml(archive.read(member))
    except XmlError as error:
        errors.append(f"{member} {error}")
        return None


def _sources(structure: Structure, archive: zipfile.ZipFile, errors: list[str]) -> dict[str, str]:
    """Component -> the member of the archive that is its FMU."""
    packed = [member for member in archive.namelist() if member.endswith(".fmu")] or ["none"]
    sources = {}
    for path, element in structure.components.items():
        source = member_of(element.get("source", ""))
        if source in archive.namelist():
            sources[flat_name(path)] = source
        else:
            errors.append(f"{'.'.join(path)} is {source!r}, which is not in the .ssp; {nearest(source, packed)}")
    return sources


def _described(path: Path, sources: Mapping[str, str], errors: list[str]) -> dict[str, FmuDescription]:
    known = {}
    for name, member in sources.items():
        try:
            with fmu_file(path / member) as file:
                known[name] = describe(file)
        except FmuError as error:
            errors.append(f"{name}: {error}")
    return known


def _grid_errors(
    known: Mapping[str, FmuDescription], text: str, overrides: Mapping[str, Any], job: Path | None
) -> list[str]:
    """Errors of FMUs whose grid differs from that of the print, a sentence for each grid."""
    try:
        document = tomlkit.parse(text)
    except TOMLKitError:
        return []  # reported by the scenario reader, as are invalid overrides
    apply_overrides(document, overrides)
    grid: Any = document.unwrap().get("grid")
    wanted = (grid.get("nx"), grid.get("ny")) if isinstance(grid, Mapping) else (None, None)
    fixed = {name: of.fixed_grid for name, of in known.items() if of.fixed_grid is not None}
    if not all(isinstance(cells, int) and cells > 0 for cells in wanted):
        return []
    owner, advice = (str(job), "take another job") if job else ("the scenario in it", "leave its grid as it is")
    return [
        f"{', '.join(name for name in fixed if fixed[name] == found)}: of a grid of {found[0]} x {found[1]} cells, "
        f"{owner} of {wanted[0]} x {wanted[1]}; export the .ssp again for that grid, or {advice}"
        for found in dict.fromkeys(fixed.values())
        if found != wanted
    ]


def _reserved(values: Mapping[str, Mapping[str, object]]) -> list[str]:
    """Errors of parameters that have the name of an option of a scenario."""
    return [
        f"parameter {component}.{name} has the name of an option of a scenario; rename it in the FMU, or leave it out"
        for component, own in values.items()
        for name in own
        if name in ("kind", *FILE_KEYS)
    ]


def _options(description: FmuDescription, values: Mapping[str, object]) -> dict[str, object]:
    """Parameters as options of a scenario, under the keys of their units."""
    options = {}
    for name, value in values.items():
        key = declared_key(name, description.variables[name].unit)
        options[key.text] = scaled(value, 1.0 / key.factor)
    return options


def _laid_over(text: str, components: Mapping[str, Any], connections: list[dict[str, Any]]) -> str:
    """The text of a scenario with other components and connections; invalid TOML is reported by the scenario reader."""
    try:
        tables: dict[str, Any] = tomlkit.parse(text).unwrap()
    except TOMLKitError:
        return text
    tables["components"] = {**tables.get("components", {}), **components}
    taken = {connection["target"] for connection in connections}
    kept = [each for each in tables.get("connections", []) if each.get("target") not in taken]
    tables["connections"] = kept + connections
    return tomlkit.dumps(tables)
