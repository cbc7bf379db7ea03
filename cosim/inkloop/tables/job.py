"""From the tables of a scenario to the job of its components."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap, FloatMap, Geometry, Ink, Job
from inkloop.contract import PassOrder
from inkloop.geometry import Columns, cell_centers, resting, support_below
from inkloop.geometry.overhang import GAP_M
from inkloop.tables.schema import Inks, InkTable, ScenarioFile
from inkloop.tables.shapes import Solid

FAR_M = 1.0
"""Replaces an infinite end of a region of ink."""
T = TypeVar("T", bound=np.generic)


@dataclass(frozen=True, eq=False)
class Target:
    """Target of a print: mask and height of the top [m], each (nx, ny).

    inks: their number; region: where ink A belongs, None: everywhere.
    """

    mask: BoolMap
    height: FloatMap
    inks: int = 1
    region: Geometry | None = None


def target_of(tables: ScenarioFile, solid: Solid) -> Target:
    """The target of a part, with its support where the scenario has one."""
    mask, top = _printed(tables, solid)
    region: Geometry | None = solid.shape
    if not is_supported(tables):
        region = None if solid.region is None else _without_ends(solid.region, top)
    return Target(_frozen(mask), _frozen(np.where(mask, top, 0.0)), 1 if region is None else 2, region)


def job_of(tables: ScenarioFile, target: Target, component: str) -> Job:
    """The job of `component`, its maps read-only; its seed is a stream of its own, derived from the scenario's."""
    grid, process = tables.grid, tables.process
    return Job(
        nx=grid.nx,
        ny=grid.ny,
        pitch=grid.pitch,
        target_height=target.height,
        mask=target.mask,
        inks=inks_of(tables.ink, target.inks),
        region=target.region,
        passes=process.passes,
        pass_order=PassOrder[process.pass_order.upper()].value,
        pass_rotation=process.pass_rotation,
        seed=component_seed(tables.seed, component),
        height_start=None if (start := _height_start(tables)) is None else _frozen(start),
    )


def ink_heights(job: Job) -> list[FloatMap]:
    """Height of each ink of the target on every cell, (nx, ny) [m]."""
    whole = np.where(job.mask, job.target_height, 0.0)
    if job.region is None:
        return [whole]
    of_a = np.zeros_like(whole)
    for low, high in job.region.intervals(*cell_centers(job.nx, job.ny, job.pitch)):
        of_a += np.maximum(np.minimum(high, whole) - np.maximum(low, 0.0), 0.0)
    return [of_a, whole - of_a]


def is_supported(tables: ScenarioFile) -> bool:
    """Whether ink B is printed to hold the part."""
    return tables.support is not None and tables.support.kind != "none"


def _printed(tables: ScenarioFile, solid: Solid) -> tuple[BoolMap, FloatMap]:
    """The printed cells, in one ink or two, and their top [m]; beyond the cells any height."""
    grid, support, shape = tables.grid, tables.support, solid.shape
    x, y = cell_centers(grid.nx, grid.ny, grid.pitch)
    part = solid.columns(grid.nx, grid.ny, grid.pitch)
    if support is None or support.kind == "none":
        stands = resting(part)
        return stands.mask, np.minimum(stands.top(x, y), shape.top(x, y))
    mask = np.zeros((grid.nx, grid.ny), dtype=np.bool_)
    margin = support.margin_cells
    mask[margin : grid.nx - margin, margin : grid.ny - margin] = True
    if support.kind == "around":
        return mask, np.full_like(x, shape.height)
    held = resting(part | support_below(part))
    return mask & held.mask, np.minimum(held.top(x, y), shape.top(x, y))


def _without_ends(region: Columns, top: FloatMap) -> Columns:
    """Ink A where it reaches the substrate or the target `top` (nx, ny) [m] continues beyond them, as ink B does.

    Else the last droplet on ink A, whose middle lies over the target, would be of ink B. Ink A that begins above the
    target, as overhangs above the printed part, is left out.
    """
    cells = region.nx * region.ny
    cell, highest = (np.repeat(values, region.counts.ravel()) for values in (np.arange(cells), top.ravel()))
    kept = (region.bottoms < highest - GAP_M).nonzero()[0]
    offsets = np.concatenate([[0], np.cumsum(np.bincount(cell[kept], minlength=cells))])
    bottoms = np.where(region.bottoms <= GAP_M, -FAR_M, region.bottoms)
    tops = np.where(region.tops >= highest - GAP_M, FAR_M, region.tops)
    return Columns(region.nx, region.ny, region.pitch, offsets, bottoms[kept], tops[kept])


def component_seed(seed: int, component: str) -> int:
    """Seed of one component's random stream (0 .. 2^31 - 1), independent of the others and of their order."""
    sequence = np.random.SeedSequence([seed, zlib.crc32(component.encode())])
    return int(sequence.generate_state(1)[0] & 0x7FFFFFFF)


def _height_start(tables: ScenarioFile) -> FloatMap | None:
    grid, table = tables.grid, tables.substrate
    return None if table is None else table.height(grid.nx, grid.ny, grid.pitch, tables.seed)


def inks_of(inks: Inks, count: int) -> tuple[Ink, ...]:
    """The inks of a print in one ink or two."""
    if inks.b is None and count == 1:
        return (inks.a.ink,)
    return inks.a.ink, (inks.b or InkTable()).ink


def _frozen(values: NDArray[T]) -> NDArray[T]:
    """The same array, read-only: jobs are shared."""
    values.flags.writeable = False
    return values
