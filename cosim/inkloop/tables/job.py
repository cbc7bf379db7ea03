"""From the tables of a scenario to the job of its components."""

from __future__ import annotations

import zlib
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap, FloatMap, Ink, Job
from inkloop.contract import PassOrder
from inkloop.geometry import Columns, Shape, cell_centers, resting, support_below
from inkloop.tables.schema import InkTable, ScenarioFile

T = TypeVar("T", bound=np.generic)


def job_of(tables: ScenarioFile, component: str) -> Job:
    """The job of `component`, its maps read-only; its seed is a stream of its own, derived from the scenario's."""
    grid, process = tables.grid, tables.process
    geometry = tables.part.geometry(grid)
    mask, top = _printed(tables, geometry)
    return Job(
        nx=grid.nx,
        ny=grid.ny,
        pitch=grid.pitch,
        target_height=_frozen(np.where(mask, top, 0.0)),
        mask=_frozen(mask),
        inks=inks_of(tables),
        region=geometry if is_supported(tables) else None,
        passes=process.passes,
        pass_order=PassOrder[process.pass_order.upper()].value,
        pass_rotation=process.pass_rotation,
        seed=component_seed(tables.seed, component),
        height_start=None if (start := _height_start(tables)) is None else _frozen(start),
    )


def is_supported(tables: ScenarioFile) -> bool:
    """Whether ink B is printed to hold the part."""
    return tables.support is not None and tables.support.kind != "none"


def _printed(tables: ScenarioFile, geometry: Shape) -> tuple[BoolMap, FloatMap]:
    """The cells that are printed, in one ink or two, and up to where [m]; beyond them any height."""
    grid, support = tables.grid, tables.support
    x, y = cell_centers(grid.nx, grid.ny, grid.pitch)
    part = Columns.of_shape(geometry, grid.nx, grid.ny, grid.pitch)
    if support is None or support.kind == "none":
        stands = resting(part)
        return stands.mask, np.minimum(stands.top(x, y), geometry.top(x, y))
    mask = np.zeros((grid.nx, grid.ny), dtype=np.bool_)
    margin = support.margin_cells
    mask[margin : grid.nx - margin, margin : grid.ny - margin] = True
    if support.kind == "around":
        return mask, np.full_like(x, geometry.height)
    held = resting(part | support_below(part))
    return mask & held.mask, np.minimum(held.top(x, y), geometry.top(x, y))


def component_seed(seed: int, component: str) -> int:
    """Seed of one component's random stream (0 .. 2^31 - 1), independent of the others and of their order."""
    sequence = np.random.SeedSequence([seed, zlib.crc32(component.encode())])
    return int(sequence.generate_state(1)[0] & 0x7FFFFFFF)


def _height_start(tables: ScenarioFile) -> FloatMap | None:
    grid, table = tables.grid, tables.substrate
    return None if table is None else table.substrate.height(grid.nx, grid.ny, grid.pitch, tables.seed)


def inks_of(tables: ScenarioFile) -> tuple[Ink, ...]:
    """The inks of the part, and of its support where it has one."""
    inks = tables.ink
    if inks.b is None and not is_supported(tables):
        return (inks.a.ink,)
    return inks.a.ink, (inks.b or InkTable()).ink


def _frozen(values: NDArray[T]) -> NDArray[T]:
    """The same array, read-only: jobs are shared."""
    values.flags.writeable = False
    return values
