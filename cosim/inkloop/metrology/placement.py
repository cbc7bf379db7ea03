"""Placement of a profiler's maps on the grid of a job: registration, cell means, datum, valid cells."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from inkloop.component import BoolMap, FloatMap, Job
from inkloop.errors import HeightMapError
from inkloop.metrology.datum import Datum, level, reference_cells
from inkloop.metrology.height_map import HeightMap
from inkloop.metrology.map_fit import fit_to_surface
from inkloop.metrology.registration import Registration, cell_means
from inkloop.units import MM_PER_M, UM_PER_M

Method: TypeAlias = Literal["given", "fiducials", "fit"]

PART_SEEN_MIN = 0.5
"""Least share of the part's cells that a scan must show (assumed)."""


@dataclass(frozen=True, eq=False)
class Placed:
    """height: (nx, ny) [m], NaN where nothing was measured; valid: (nx, ny); words: remarks."""

    height: FloatMap
    valid: BoolMap
    words: str


@dataclass(frozen=True)
class Placement:
    """registration: of every map, or with `fit_reach` the start of a fit for each map.

    share_min: least measured share of a valid cell; fit_reach: (shift [m], rotation [rad]) of a fit to the part;
    datum_margin: cells around the part that are left out of the datum.
    """

    job: Job
    registration: Registration
    share_min: float = 0.5
    fit_reach: tuple[float, float] | None = None
    datum: Datum = "none"
    datum_margin: int = 1

    def place(self, map_: HeightMap, layer: int) -> Placed:
        """The cells of a map of the surface after a layer. Raises HeightMapError that names the map's file."""
        job, words = self.job, []
        if not map_.valid.any():
            raise HeightMapError(
                f"{map_.source}: no pixel of it was measured; scan again, with more light or a slower scan"
            )
        registration = self.registration
        if self.fit_reach is not None and layer > 0:
            reach, rotation_reach = self.fit_reach
            printed = np.minimum(job.target_height, layer * job.inks[0].layer_height)
            fit = fit_to_surface(map_, printed, job.pitch, registration, reach=reach, rotation_reach=rotation_reach)
            registration = fit.registration
            words.append(
                f"fitted to {fit.offset_std * UM_PER_M:.2g} µm, {fit.explained:.0%} of its relief is the part's"
            )
        cells = cell_means(map_, registration, job.nx, job.ny, job.pitch)
        valid = cells.valid(self.share_min)
        seen = np.count_nonzero(valid & job.mask) / np.count_nonzero(job.mask)
        if seen < PART_SEEN_MIN:
            raise HeightMapError(f"{map_.source}: {seen:.0%} of the part's cells were measured; {self._advice(map_)}")
        try:
            height = level(
                np.where(valid, cells.mean, np.nan), reference_cells(job.mask, self.datum_margin), self.datum
            )
        except HeightMapError as error:
            raise HeightMapError(f"{map_.source}: {error}") from error
        words.insert(0, f"{seen:.0%} of the part measured")
        return Placed(height, valid, ", ".join(words))

    def _advice(self, map_: HeightMap) -> str:
        """Likely cause if the part is not visible: the placement, or the pixels."""
        job = self.job
        corners = np.array([[0, 0], [0, 1], [1, 0], [1, 1]]) * [map_.shape[0] * map_.dx, map_.shape[1] * map_.dy]
        x, y = self.registration.to_grid(corners[:, 0] + map_.x0, corners[:, 1] + map_.y0)
        along_x, along_y = (f"{c.min() * MM_PER_M:.2f} to {c.max() * MM_PER_M:.2f}" for c in (x, y))
        field = f"x {along_x}, y {along_y} mm"
        grid = f"0 to {job.nx * job.pitch * MM_PER_M:.2f} and 0 to {job.ny * job.pitch * MM_PER_M:.2f} mm"
        return (
            f"needs {PART_SEEN_MIN:.0%}. Its field lies at {field}, the grid at {grid}, and {map_.valid.mean():.0%} of "
            "its pixels hold a height: correct offset, rotation, mirror or pixel size, or scan again"
        )
