"""Subject of an evaluation: a map, the part on it, its substrate and its target."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inkloop.component import BoolMap, FloatMap
from inkloop.errors import HeightMapError
from inkloop.metrology.datum import plane, reference_cells
from inkloop.metrology.evaluation.definitions import DEFINITIONS, Treatment, symbols
from inkloop.metrology.evaluation.form import EDGE, Points, central_third, flatness, parallelism, step, step_height
from inkloop.metrology.evaluation.outline import outline_parameters
from inkloop.metrology.evaluation.surface import (
    CELLS_MIN,
    Found,
    Refusal,
    asked_cells,
    cells_refusal,
    refused,
    s_filtered,
)
from inkloop.metrology.height_map import HeightMap
from inkloop.units import UM_PER_M

SUPPORT = 0.2
"""Share of the step above which cells outside the part are printed, not substrate (assumed)."""


@dataclass(frozen=True, eq=False)
class Subject:
    """A map with the cells of the part (None: all of them).

    target: nominal height of the part; start: surface before the print, both (m, n) [m] where known; droplets: number
    of droplets. Raises HeightMapError for maps of another shape.
    """

    map_: HeightMap
    mask: BoolMap | None = None
    target: FloatMap | None = None
    start: FloatMap | None = None
    droplets: int | None = None

    def __post_init__(self) -> None:
        asked_cells(self.map_, self.mask)
        for name in ("target", "start"):
            given = getattr(self, name)
            if given is not None and given.shape != self.map_.shape:
                raise HeightMapError(f"{self.map_.source}: has {self.map_.shape} cells, its {name} {given.shape}")

    @property
    def cells(self) -> BoolMap:
        """The cells to evaluate."""
        return asked_cells(self.map_, self.mask)

    @property
    def applicable(self) -> tuple[str, ...]:
        """The parameters that have a meaning here: no volume of a map that is no part, no error without a target."""
        part = None if self.mask is None and self.start is None else self.cells
        known = {"": self.map_, "part": part, "target": self.target, "droplets": self.droplets}
        return tuple(symbol for symbol, each in DEFINITIONS.items() if known[each.needs] is not None)

    def substrate(self) -> Points | Refusal:
        """The surface before the print; for a map the cells around the part, without outliers."""
        if self.start is not None:
            return self._points(self.start, np.isfinite(self.start))
        around = self._plane_around()
        return around if isinstance(around, Refusal) else self._points(self.map_.z, around[1])

    def substrate_heights(self) -> FloatMap | Refusal:
        """(m, n) below the part: the start surface, or the least-squares plane of the cells around the part."""
        if self.start is not None:
            return self.start
        around = self._plane_around()
        return around if isinstance(around, Refusal) else around[0]

    def _plane_around(self) -> tuple[FloatMap, BoolMap] | Refusal:
        """The plane of the cells around the part, and the cells that lie on it."""
        around = self._around
        if np.count_nonzero(around) < CELLS_MIN:
            return Refusal(
                f"{np.count_nonzero(around)} cells with heights lie more than {EDGE} cells outside the mask; the "
                f"substrate needs {CELLS_MIN}: measure a wider field, or evaluate a run"
            )
        try:
            return plane(self.map_.z, around)
        except HeightMapError as error:
            return Refusal(str(error))

    def form_parameters(self, treatment: Treatment | None = None) -> Found:
        """All parameters of the group "form": of the heights after the S-filter alone, form and waves included."""
        cells, how = self.cells, treatment or Treatment()
        used = cells & self.map_.valid
        if reason := cells_refusal(used, cells, how.missing_max):
            return refused(symbols("form"), reason.reason)
        map_ = s_filtered(self.map_, how)
        if isinstance(map_, Refusal):
            return refused(symbols("form"), map_.reason)
        top, substrate = self._points(map_.z, used), self.substrate()
        inner = central_third(cells, self._sizes) & used
        target = None if self.target is None else self.target[inner]
        rise = step(self._points(map_.z, inner), substrate, target)
        around = rise if isinstance(rise, Refusal) else self._surroundings(rise.ls) or rise
        return {
            **flatness(top),
            **parallelism(top, substrate),
            **step_height(rise),
            **outline_parameters(map_, around),
        }

    def _surroundings(self, height: float) -> Refusal | None:
        """The reason why the part has no free wall: its surroundings."""
        below = self.substrate_heights()
        if isinstance(below, Refusal) or not self._around.any():
            return Refusal(f"no cell with a height lies more than {EDGE} cells outside the mask")
        rise = float(np.median((self.map_.z - below)[self._around]))
        if abs(rise) <= SUPPORT * height:
            return None
        return Refusal(f"the cells around the part stand {rise * UM_PER_M:.4g} µm above the substrate: no wall is free")

    @property
    def _around(self) -> BoolMap:
        return np.asarray(reference_cells(self.cells, EDGE) & self.map_.valid, np.bool_)

    @property
    def _sizes(self) -> tuple[float, float]:
        return self.map_.dx, self.map_.dy

    def _points(self, z: FloatMap, cells: BoolMap) -> Points:
        return Points.of(z, cells, *self._sizes)
