"""The propagation of volume and area of Wu and Chiu (2024), drop by drop."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inkloop.component import FloatMap
from inkloop.contract import pass_colour, pass_colours
from inkloop_lab.models.library import (
    SIZES,
    CapSharesStruct,
    DropModelStruct,
    InkMapStruct,
    heights,
    library,
    passes_of,
    pattern_of,
    positive,
    reals,
    volumes,
)

CAP_RADIUS_PER_PITCH = 0.6  # gives the height differences of Wu, Chiu 2024, eq. 19


@dataclass(frozen=True, eq=False)
class InkSurface:
    """substrate: (nx, ny) bare of ink [m]; height: (nx, ny) substrate + volume of ink / area of a cell [m]; area: share
    of each cell that is covered, 0 to 1.
    """

    substrate: FloatMap
    height: FloatMap
    area: FloatMap

    @property
    def covered_height(self) -> FloatMap:
        """(nx, ny) height of the covered part over the substrate, h of the paper, 0 on bare cells [m] (eq. 2)."""
        ink = self.height - self.substrate
        return np.divide(ink, self.area, out=np.zeros_like(ink), where=self.area > 0.0)


@dataclass(frozen=True)
class VolumeAreaDeposition:
    """Volume v (in drops) and covered share a of each cell, h = c v / a. A drop on cell p acts on the 3 x 3 cells
    around it; with h~ the height of a cell less the mean of those that touch it inside, before the drop:

        dv_q = mv_plus h~ or mv_minus h~, by the sign of h~;   dv_p = 1 - sum of dv_q
        da_q = ma_plus h~ or ma_minus h~, a_q at most 1;       a_p = 1

    On flat ground it is a spherical cap of base radius `cap_radius` (0: 0.6 pitch). pitch, height_scale c [m]; the
    coefficients [1/m]; guard, limit_gains, drop_order (1 line by line, 2 to and fro, 3 along x first), passes,
    pass_order and pass_rotation as in the FMU VolumeAreaDeposition. Source: Wu, Chiu 2024, equations 1 to 13, defaults
    (20). Raises ValueError.
    """

    pitch: float = 90e-6
    height_scale: float = 7.0751e-6
    mv_plus: float = 6700.0
    mv_minus: float = -20100.0
    ma_plus: float = 0.0
    ma_minus: float = -63400.0
    cap_radius: float = 0.0
    guard: bool = False
    limit_gains: bool = False
    drop_order: int = 1
    passes: int = 1
    pass_order: int = 1
    pass_rotation: int = 0

    def __post_init__(self) -> None:
        positive(pitch=self.pitch, height_scale=self.height_scale)
        passes_of(self.passes, self.pass_order, self.pass_rotation)
        coefficients = (self.mv_plus, self.mv_minus, self.ma_plus, self.ma_minus)
        if (
            not np.isfinite(coefficients).all()
            or not 0.0 <= self.cap_radius < np.inf
            or self.drop_order not in (1, 2, 3)
        ):
            raise ValueError(
                f"coefficients are {coefficients}, cap_radius {self.cap_radius}, drop_order {self.drop_order}; needs "
                "finite numbers, a radius of at least 0 m, an order of 1 to 3"
            )

    def start(self, height: ArrayLike, area: ArrayLike | None = None, substrate: ArrayLike | None = None) -> InkSurface:
        """A surface (nx, ny) [m]: a bare substrate, or with `area` what lies on `substrate` (default: flat, 0).

        Raises ValueError.
        """
        top = heights(height)
        if area is None:
            return InkSurface(top, top.copy(), np.zeros_like(top))
        covered = heights(area, "area", inf)
        below = np.zeros_like(top) if substrate is None else heights(substrate, "substrate")
        if covered.shape != top.shape or below.shape != top.shape or (covered < 0.0).any() or (covered > 1.0).any():
            raise ValueError(f"area {covered.shape}, substrate {below.shape}: need {top.shape}, areas of 0 to 1")
        return InkSurface(below, top, covered)

    def layer(
        self, surface: InkSurface, pattern: ArrayLike, number: int = 1, volume: ArrayLike | None = None
    ) -> InkSurface:
        """The surface after layer `number`; arguments as of `LayerDeposition.layer`, A and B flow alike."""
        height, area, substrate = (
            heights(surface.height),
            heights(surface.area, "area", inf),
            heights(surface.substrate),
        )
        nx, ny = shape = (height.shape[0], height.shape[1])
        jetted, drops = pattern_of(pattern, shape), volumes(volume, shape)
        map_ = InkMapStruct(reals(substrate), reals(height), reals(area), nx, ny)
        model = DropModelStruct(
            self.height_scale,
            self.mv_plus,
            self.mv_minus,
            self.ma_plus,
            self.ma_minus,
            self._cap_shares(),
            self.guard,
            self.limit_gains,
        )
        cells = self._sequence(jetted, number)
        library().inkloop_add_drops(
            ctypes.byref(map_), ctypes.byref(model), cells.ctypes.data_as(SIZES), cells.size, reals(drops)
        )
        return InkSurface(substrate, height, area)

    def _cap_shares(self) -> CapSharesStruct:
        radius = self.cap_radius or CAP_RADIUS_PER_PITCH * self.pitch
        shares = CapSharesStruct()
        library().inkloop_cap_shares(self.height_scale, radius, self.pitch, ctypes.byref(shares))
        return shares

    def _sequence(self, pattern: NDArray[np.int32], number: int) -> NDArray[np.uintp]:
        """Cells of the droplets in the order in which they fall."""
        cells = np.arange(pattern.size, dtype=np.uintp).reshape(pattern.shape)
        if self.drop_order == 2:
            cells[1::2] = cells[1::2, ::-1].copy()
        in_order = (cells.T if self.drop_order == 3 else cells).ravel()
        hit = in_order[pattern.ravel()[in_order] > 0]
        colours = pass_colours(self.passes, self.pass_order, self.pass_rotation, number)
        if not colours:
            return np.ascontiguousarray(hit)
        own = pass_colour(hit // pattern.shape[1], hit % pattern.shape[1])
        return np.concatenate([hit[own == colour] for colour in colours])
