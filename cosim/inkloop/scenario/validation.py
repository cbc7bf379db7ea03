"""Errors of the components of a scenario, their connections and events, one sentence each.

Errors in one table do not hide those in others: connections and events are checked for the components whose ports are
known, and options with a substitute job if the tables of the job are invalid.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from inkloop.component import HasPorts, Job, Ports, is_device, is_shadow
from inkloop.components import catalog
from inkloop.components.kind import Checked
from inkloop.contract import HEIGHT, LAYERS_PRINTED, LAYERS_SCANNED, has_port
from inkloop.geometry import Columns, overhangs, resting
from inkloop.master.wiring import Connection, find
from inkloop.scenario.events import find_event_port
from inkloop.tables.job import Target, is_supported
from inkloop.tables.schema import ComponentTable, ScenarioFile
from inkloop.tables.shapes import Bounds, Grid, Solid
from inkloop.units import UM_PER_M

SIDE = 9
"""Cells along an edge of a grid whose own number is invalid."""
EMPTY_CELLS = 2
"""Cells to leave empty around a part: a droplet reaches one, and the next shows the substrate."""
_MORE_CELLS = "change grid.pitch_um, grid.nx and grid.ny"


def part_errors(tables: ScenarioFile, solid: Solid, target: Target) -> list[str]:
    """Errors of the part on its grid."""
    grid, is_printed = tables.grid, bool(target.mask.any())
    has_support, reaches = is_supported(tables), solid.bounds
    errors = []
    if tables.support is None or not (has_support or is_printed):
        errors += _overhang_errors(solid.columns(grid.nx, grid.ny, grid.pitch), solid.region is not None)
    if not is_printed and not errors:
        errors.append(
            f"part covers no cell of the grid{_found(grid, reaches)}; make it larger, move it, or {_MORE_CELLS}"
        )
    if has_support and solid.region is not None:
        errors.append(
            'part has two inks, and support takes ink B for itself; set support.kind = "none", or leave out one ink'
        )
    margin = tables.support.margin_cells if has_support and tables.support else 0
    crosses_block = has_support and not np.isfinite(reaches).all()  # as pipes without end do
    if not crosses_block and _is_beyond(grid, margin, reaches):
        errors.append(_too_wide(grid, margin, reaches))
    return errors


def checked_options(table: ComponentTable, job: Job, folder: Path) -> Checked:
    """The options of a component, checked for its job."""
    if not job.mask.any():  # an error of the part; the components are checked all the same
        job = replace(job, mask=~job.mask)
    return catalog.check(table.kind, job, catalog.resolve_paths(table.kind, table.options, folder))


def _found(grid: Grid, bounds: Bounds) -> str:
    """Size of a part and of a cell, where the part has an end."""
    sides = bounds.x_max - bounds.x_min, bounds.y_max - bounds.y_min
    if not np.isfinite(sides).all():
        return ""
    size = " x ".join(f"{side * UM_PER_M:.6g}" for side in sides)
    return f": it is {size} µm wide, a cell {grid.pitch * UM_PER_M:.6g} µm"


def _is_beyond(grid: Grid, margin: int, bounds: Bounds) -> bool:
    """Whether a part reaches the centre of a cell outside the grid less its margin."""
    below = (margin - 1) * grid.pitch
    x_above, y_above = ((count - margin) * grid.pitch for count in (grid.nx, grid.ny))
    is_in_x = below < bounds.x_min and bounds.x_max < x_above
    return not (is_in_x and below < bounds.y_min and bounds.y_max < y_above)


def _too_wide(grid: Grid, margin: int, bounds: Bounds) -> str:
    sides = bounds.x_max - bounds.x_min, bounds.y_max - bounds.y_min
    place = f"the grid of {grid.nx} x {grid.ny} cells" + (f" less its margin of {margin}" if margin else "")
    if not np.isfinite(sides).all():
        return f"part reaches beyond {place}: it has no end; add [support], which fills a block around it, or cut it"
    needed = (math.ceil(side / grid.pitch) + 2 * max(margin, EMPTY_CELLS) for side in sides)
    size = " x ".join(f"{side * UM_PER_M:.6g}" for side in sides)
    counts = " and ".join(f"{axis} >= {count}" for axis, count in zip(("grid.nx", "grid.ny"), needed, strict=True))
    return (
        f"part reaches beyond {place}: it is {size} µm wide; with {counts} it fits in the middle with "
        f"{max(margin, EMPTY_CELLS)} empty cells around it; or move it, or make it smaller"
    )


def _overhang_errors(part: Columns, in_two_inks: bool) -> list[str]:
    """The error of overhangs in a part whose file does not define their support."""
    found = overhangs(part)
    if found is None:
        return []
    rest = int(resting(part).mask.sum())
    alone = f'kind = "none" to print alone what rests on the substrate ({rest} cells)' if rest else ""
    below = 'kind = "below-overhangs" or "around", which print ink B there'
    advice = f"[support] with {below}" + (f", or {alone}" if rest else "")
    if in_two_inks:
        rests = f"[support] with {alone}" if rest else "ink below them to the part"
        advice = f"{rests}; other supports need ink B, which is the part's here"
    return [
        f"part: {found.cells} cells ({found.share:.1%}) have nothing below them, first at {found.first} from "
        f"{found.bottom * UM_PER_M:.4g} µm, up to {found.tallest * UM_PER_M:.4g} µm of air; a droplet cannot hang: add "
        f"{advice}"
    ]


def known_ports(checked: Mapping[str, Checked]) -> tuple[dict[str, Ports], list[str]]:
    """The ports of components, and the names of those whose options have errors: their ports are unknown."""
    ports = {name: part.ports for name, part in checked.items() if part.ports is not None}
    return ports, [name for name in checked if name not in ports]


def end_errors(
    ports: Mapping[str, HasPorts], unknown: Collection[str], connections: Sequence[tuple[str, str]]
) -> list[str]:
    """Errors of (output, input), each "component.port"; ends at components with unknown ports are left out."""
    errors: list[str] = []
    for ends in connections:
        for place, direction in zip(ends, ("output", "input"), strict=True):
            by_name = {name: {} for name in unknown} | {
                name: {port.name: port for port in getattr(component, f"{direction}s")}
                for name, component in ports.items()
            }
            if place.partition(".")[0] not in unknown:
                find(place, by_name, direction, errors)
    return errors


def mix_errors(components: Mapping[str, HasPorts]) -> list[str]:
    """Errors in combining devices and simulated parts; empty if they fit.

    A device that prints needs a device that scans and the other way round, or a shadow: a model that follows the
    commanded patterns.
    """
    if any(is_shadow(component) for component in components.values()):
        return []
    advice = 'add a component with kind = "Shadow", a model that follows the commanded patterns'
    errors = []
    for printer in _giving(LAYERS_PRINTED, components):
        for profiler in _giving(LAYERS_SCANNED, components):
            if is_device(components[printer]) and not is_device(components[profiler]):
                errors.append(
                    f"{printer} is a device and {profiler} simulates a sensor, which has no surface to scan; {advice} "
                    f"and gives {profiler} its height, or make {profiler} a device"
                )
            elif is_device(components[profiler]) and not is_device(components[printer]):
                errors.append(
                    f"{profiler} is a device and {printer} simulates a printer, of which {profiler} sees nothing; "
                    f"{advice}, to be compared with the scans, or make {printer} a device"
                )
    return errors


def shadow_errors(components: Mapping[str, HasPorts], connections: Sequence[Connection]) -> list[str]:
    """A shadow that a sensor scans must not begin on those scans."""
    errors = []
    fed = {connection.target_parts: connection.source_parts for connection in connections}
    for name, component in components.items():
        sensor, _ = fed.get((name, LAYERS_SCANNED), ("", ""))
        scans_shadow = fed.get((sensor, HEIGHT)) == (name, HEIGHT)
        if is_shadow(component) and scans_shadow and getattr(component, "starts_on_scan", False):
            errors.append(
                f'{name} begins on the first scan of {sensor}, which scans {name} itself; write start = "job" in '
                f"components.{name}, or let {sensor} scan a printer"
            )
    return errors


def errors_of_invalid_file(raw: Mapping[str, Any], folder: Path) -> list[str]:
    """Errors of options, ends of connections and ports of events in a file whose other tables are invalid.

    raw: the file as read; folder: where it stands.
    """
    checked = _checked(raw, folder)
    ports, _ = known_ports(checked)
    unknown = [name for name in map(str, _table(raw, "components")) if name not in ports]
    errors = [f"components.{name}.{error}" for name, part in checked.items() for error in part.errors]
    connections = [
        (source, target)
        for _, table in _rows(raw, "connections")
        if isinstance(source := table.get("source"), str) and isinstance(target := table.get("target"), str)
    ]
    errors += end_errors(ports, unknown, connections)
    for number, table in _rows(raw, "events"):
        if isinstance(place := table.get("port"), str):
            errors += [f"events.[{number}].{error}" for error in find_event_port(place, ports, unknown)[1]]
    return errors


def _checked(raw: Mapping[str, Any], folder: Path) -> dict[str, Checked]:
    """The components whose kind can be read, their options checked for a flat job on a grid as far as it is valid."""
    nx, ny = (_cells(_table(raw, "grid").get(edge)) for edge in ("nx", "ny"))
    job = Job(nx, ny, pitch=1e-4, target_height=np.zeros((nx, ny)), mask=np.ones((nx, ny), dtype=np.bool_))
    checked = {}
    for name, table in _table(raw, "components").items():
        if isinstance(table, Mapping) and isinstance(kind := table.get("kind"), str):
            options = {key: value for key, value in table.items() if key != "kind"}
            checked[str(name)] = catalog.check(kind, job, catalog.resolve_paths(kind, options, folder))
    return checked


def _cells(found: object) -> int:
    return found if isinstance(found, int) and 1 <= found <= 1000 else SIDE


def _table(raw: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    found = raw.get(key)
    return found if isinstance(found, Mapping) else {}


def _rows(raw: Mapping[str, Any], key: str) -> Iterator[tuple[int, Mapping[str, Any]]]:
    """The tables of an array of tables, each with its number."""
    found = raw.get(key)
    for number, row in enumerate(found if isinstance(found, list) else []):
        if isinstance(row, Mapping):
            yield number, row


def _giving(output: str, components: Mapping[str, HasPorts]) -> Iterable[str]:
    return [name for name, part in components.items() if has_port(part.outputs, output)]
