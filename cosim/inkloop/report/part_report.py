"""Report on a part before it is printed: size, holes, narrow walls and gaps, and time and material of its print."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from textwrap import wrap
from typing import Any

import numpy as np

from inkloop.geometry import Columns
from inkloop.geometry.body import Body
from inkloop.geometry.mesh_columns import SAMPLED_DIGITS, measured
from inkloop.limits import duration_text, plain_text, rounded_text, size_text
from inkloop.report.part_flaws import Hole, Narrow, holes, narrow_across, narrow_upright, solids
from inkloop.scenario.file import Scenario
from inkloop.scenario.part_grid import MANY_LAYERS
from inkloop.scenario.support import Supported
from inkloop.tables.job import ink_heights
from inkloop.units import MM3_PER_M3, MM_PER_M, NL_PER_M3, UM_PER_M

HOLES_SHOWN = 10
LEVELS = 100
"""Largest number of heights at which walls and gaps are searched."""
CELLS_MIN = 2
"""Cells of the narrowest wall or gap that is printed as such: one alone is a row of droplets."""
WIDTH = 80
"""Characters of a line."""
DIGITS = 5
"""Digits of sizes and volumes."""
SCAN_S = 6.0
"""`scan_duration` of the sensor where the scenario gives none."""


@dataclass(frozen=True, eq=False)
class MeshReport:
    """A mesh in its file: separate solids, triangles, size [m], holes, names of objects or materials.

    assumed_unit: of the coordinates, where nothing states it; digits: those of the size that are known.
    """

    bodies: int
    triangles: int
    size: tuple[float, float, float]
    holes: list[Hole]
    names: tuple[str, ...]
    assumed_unit: str = ""
    digits: int = DIGITS

    @classmethod
    def of(cls, bodies: Sequence[Body], assumed_unit: str = "") -> MeshReport:
        """The report of placed bodies."""
        found = measured(bodies)
        x, y, z = (float(side) for side in found.high - found.low)
        digits = SAMPLED_DIGITS if found.box_is_sampled else DIGITS
        names = tuple(dict.fromkeys(body.name or body.material for body in bodies if body.name or body.material))
        count = sum(len(body.triangles) for body in bodies)
        return cls(sum(map(solids, bodies)), count, (x, y, z), holes(bodies), names, assumed_unit, digits)

    def lines(self) -> Iterator[str]:
        """For a person."""
        yield f"mesh           {_counted(self.bodies, 'body', 'bodies')}, {self.triangles:,} triangles"
        assumed = f", if the unit of the file is {self.assumed_unit}: --unit" if self.assumed_unit else ""
        yield f"size           {_lengths(self.size, digits=self.digits)} mm{assumed}"
        if len(self.names) > 1:
            yield from wrap(", ".join(self.names), WIDTH, initial_indent="objects        ", subsequent_indent=" " * 15)
        if not self.holes:
            yield "surface        watertight"
            return
        seams = sum(hole.is_seam for hole in self.holes)
        counts = [(len(self.holes) - seams, "hole", "holes"), (seams, "seam", "seams")]
        found = " and ".join(_counted(*each) for each in counts if each[0])
        yield f"surface        not watertight: {found}" + (", the largest" if len(self.holes) > 1 else "")
        for hole in self.holes[:HOLES_SHOWN]:
            kind = ", a seam" if hole.is_seam else ""
            yield f"               {hole.size * MM_PER_M:.4g} mm across at ({_lengths(hole.center, ', ')}) mm{kind}"
        if seams:
            yield "               (seam: no face is missing, but one side of it is turned over)"

    def data(self) -> dict[str, Any]:
        """For a program."""
        return {
            "bodies": self.bodies,
            "triangles": self.triangles,
            "names": list(self.names),
            "size_mm": [side * MM_PER_M for side in self.size],
            "watertight": not self.holes,
            "holes": [
                {
                    "size_mm": hole.size * MM_PER_M,
                    "center_mm": [value * MM_PER_M for value in hole.center],
                    "edges": hole.edges,
                    "seam": hole.is_seam,
                }
                for hole in self.holes[:HOLES_SHOWN]
            ],
            "hole_count": len(self.holes),
        }


@dataclass(frozen=True, eq=False)
class PartReport:
    """The part of a scenario on its grid. narrow: walls and gaps narrower than droplets can print, by name."""

    scenario: Scenario
    part: Columns
    narrow: dict[str, Narrow]
    cells_min: int

    @classmethod
    def of(
        cls, scenario: Scenario, nozzle: float | None, track: Callable[[list[float]], Iterable[float]] = iter
    ) -> PartReport:
        """The report of a scenario; nozzle: width of what it prints at least [m], two cells if that is less.

        track: shows how far the search is among the heights [m].
        """
        grid = scenario.tables.grid
        part = scenario.solid.columns(grid.nx, grid.ny, grid.pitch)
        layer = scenario.tables.ink.a.ink.layer_height
        cells_min = max(CELLS_MIN, math.ceil((nozzle or 0.0) / grid.pitch - 1e-9))
        count = min(LEVELS, max(1, math.ceil(part.height / layer)))
        levels = (np.arange(count) + 0.5) / count * part.height
        ends = np.unique(np.concatenate([part.bottoms, part.tops]))
        between = np.unique(np.searchsorted(ends, levels, side="right"), return_index=True)[1]
        walls, gaps = narrow_across(part, cells_min, track(levels[between].tolist()))
        sheets, slots = narrow_upright(part, layer)
        found = {
            "walls": walls,
            "gaps": gaps,
            "sheets": sheets,
            "slots": slots,
        }
        return cls(scenario, part, {name: each for name, each in found.items() if each is not None}, cells_min)

    @property
    def size(self) -> tuple[float, float, float]:
        """Width, depth and height [m]."""
        box = self.scenario.solid.bounds
        return box.x_max - box.x_min, box.y_max - box.y_min, self.part.height

    @property
    def size_line(self) -> str:
        """The size for a person; a part without an end has that of its block."""
        grid = self.scenario.tables.grid
        sides = [min(side, count * grid.pitch) for side, count in zip(self.size, (grid.nx, grid.ny), strict=False)]
        return f"size           {_lengths([*sides, self.part.height])} mm"

    @property
    def volumes(self) -> dict[str, float]:
        """Volume of each ink in the target [m3]."""
        job = self.scenario.job()
        return {
            name: float(heights.sum()) * job.pitch**2 for name, heights in zip("AB", ink_heights(job), strict=False)
        }

    @property
    def droplets(self) -> dict[str, int]:
        """Nominal droplets of each ink."""
        job = self.scenario.job()
        heights = {name: ink.layer_height for name, ink in zip("AB", job.inks, strict=False)}
        return {name: round(volume / (heights[name] * job.pitch**2)) for name, volume in self.volumes.items()}

    @property
    def scan_time(self) -> float:
        """Time of the scans and layers by the durations that the scenario gives [s]."""
        options = [table.options for table in self.scenario.tables.components.values()]
        scans = [own["scan_duration_s"] for own in options if isinstance(own.get("scan_duration_s"), int | float)]
        layers = [own["layer_duration_s"] for own in options if isinstance(own.get("layer_duration_s"), int | float)]
        return self.scenario.footprint.layers * (max(scans, default=SCAN_S) + max(layers, default=0.0))

    def lines(self) -> Iterator[str]:
        """For a person."""
        grid, footprint = self.scenario.tables.grid, self.scenario.footprint
        job = self.scenario.job()
        width, height = self.cells_min * grid.pitch_um, self.scenario.tables.ink.a.ink.layer_height * UM_PER_M
        yield f"grid           {grid.nx} x {grid.ny} cells of {grid.pitch_um:g} µm, {int(job.mask.sum()):,} printed"
        yield f"volume         {plain_text(self.part.volume * MM3_PER_M3, DIGITS)} mm3 on these cells"
        volume, is_sampled = self.scenario.solid.volume, self.scenario.solid.volume_is_sampled
        if volume:
            share, volume_mm3 = self.part.volume / volume - 1.0, volume * MM3_PER_M3
            known, about, places = plain_text(volume_mm3, DIGITS), "", 1
            if is_sampled:
                known, about, places = rounded_text(volume_mm3, SAMPLED_DIGITS), "about ", 0
            found = f"{abs(share):.{places}%} {'more' if share > 0.0 else 'less'}"
            more = found if abs(share) >= 0.5 * 0.1 ** (places + 2) else "the same"
            yield f"               {about}{known} mm3 in the file, the cells hold {about}{more}"
        texts = {
            "walls": f"walls below {width:g} µm ({self.cells_min} cells)",
            "gaps": f"gaps below {width:g} µm ({self.cells_min} cells)",
            "sheets": f"lower than a layer ({height:.3g} µm)",
            "slots": f"gaps lower than a layer ({height:.3g} µm)",
        }
        if not self.narrow:
            yield f"narrow         nothing: no wall, no gap below {width:g} µm"
        for name, each in self.narrow.items():
            yield f"narrow         {texts[name]}: {_counted(int(each.cells.sum()), 'cell', 'cells')},"
            yield f"               first at ({_lengths(each.first, ', ')}) mm"
        for remark in self.scenario.solid.remarks:
            yield from wrap(remark, WIDTH, initial_indent="warning        ", subsequent_indent=" " * 15)
        droplets, volumes = self.droplets, self.volumes
        for name in volumes:
            volume_nl = plain_text(volumes[name] * NL_PER_M3, DIGITS)
            yield f"ink {name}          {volume_nl} nl, about {droplets[name]:,} droplets"
        to_try = "; to try it: a smaller scale, or run.layers_max = 20"
        if support := Supported.of(self.scenario):
            yield f"support        {support}"
        yield f"layers         about {footprint.layers}" + (to_try if footprint.layers > MANY_LAYERS else "")
        if self.scan_time:
            yield f"time           about {duration_text(self.scan_time)} of layers and scans"
        yield f"computing      {footprint.computing.replace(' of computing', '')}"
        yield f"memory, disk   {size_text(footprint.memory)}, {size_text(footprint.disk)}"

    def data(self) -> dict[str, Any]:
        """For a program."""
        grid, footprint, job = self.scenario.tables.grid, self.scenario.footprint, self.scenario.job()
        volume = self.scenario.solid.volume
        return {
            "grid": {"nx": grid.nx, "ny": grid.ny, "pitch_um": grid.pitch_um},
            "cells_printed": int(job.mask.sum()),
            "height_mm": self.part.height * MM_PER_M,
            "volume_mm3": self.part.volume * MM3_PER_M3,
            "file_volume_mm3": None if volume is None else volume * MM3_PER_M3,
            "narrow_below_cells": self.cells_min,
            "narrow": {
                name: {"cells": int(each.cells.sum()), "first_mm": [value * MM_PER_M for value in each.first]}
                for name, each in self.narrow.items()
            },
            "warnings": list(self.scenario.solid.remarks),
            "ink_nl": {name: volume * NL_PER_M3 for name, volume in self.volumes.items()},
            "droplets": self.droplets,
            "support": support.data() if (support := Supported.of(self.scenario)) else None,
            "layers": footprint.layers,
            "layers_and_scans_s": self.scan_time,
            "processor_s": footprint.seconds,
            "memory_bytes": footprint.memory,
            "disk_bytes": footprint.disk,
        }


def _lengths(values: Sequence[float], between: str = " x ", digits: int = DIGITS) -> str:
    return between.join(f"{value * MM_PER_M:.{digits}g}" for value in values)


def _counted(count: int, one: str, more: str) -> str:
    return f"{count:,} {one if count == 1 else more}"
