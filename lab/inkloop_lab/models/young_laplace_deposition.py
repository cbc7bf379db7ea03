"""Lines of droplets that flow together and rest under surface tension (Hume and Rosen 2018)."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from inkloop.component import FloatMap
from inkloop.contract import pass_colours
from inkloop.errors import InkloopError
from inkloop.units import UM_PER_M
from inkloop_lab.models.library import (
    FineSurfaceStruct,
    LiquidStruct,
    heights,
    library,
    passes_of,
    pattern_of,
    positive,
    reals,
    volumes,
)

FORMS = {"linear": 1, "nonlinear": 2}
WIDEST_SPREAD = 2  # pitches (fine_surface.h)
_NO_MEMORY = -(2**31)


@dataclass(frozen=True, eq=False)
class FineSurface:
    """height: (nx, ny) mean over each cell [m]; fine: the surface itself [m], at points `spacing` [m] apart, with a rim
    of `rim` points around the grid for the liquid that flows over its border; fallbacks: bodies without a nonlinear
    solution so far; lost: volume beyond the border [m3].
    """

    height: FloatMap
    fine: FloatMap
    spacing: float
    rim: int
    fallbacks: int = 0
    lost: float = 0.0

    @property
    def over_grid(self) -> FloatMap:
        """The fine surface without its rim."""
        return self.fine[self.rim : -self.rim, self.rim : -self.rim]


@dataclass(frozen=True)
class YoungLaplaceDeposition:
    """Neighbouring droplets of a line (along x) are one liquid body. Its footprint is the convex hull of the spread
    droplets, its edge stays there, its volume is given, and its surface h has constant mean curvature, nonlinear
    div(grad h / sqrt(1 + |grad h|^2)) = -p / sigma, or linear: laplace h = -p / sigma; h never cuts into the solid
    below.

    pitch [m], droplet_volume [m3], contact_angle [rad], cells_per_pitch points of the fine surface per cell; passes =
    4: lines 0, 4, 8 ... first, then 1, 5, 9 ..., each pass on the solid of the pass before. Source: Hume, Rosen 2018,
    equations 3 to 5. Raises ValueError.
    """

    pitch: float = 42.3e-6
    droplet_volume: float = 30e-15
    contact_angle: float = 0.7853981633974483
    form: Literal["linear", "nonlinear"] = "nonlinear"
    cells_per_pitch: int = 8
    passes: int = 4
    pass_order: int = 1
    pass_rotation: int = 0

    def __post_init__(self) -> None:
        positive(pitch=self.pitch, droplet_volume=self.droplet_volume)
        passes_of(self.passes, self.pass_order, self.pass_rotation)
        if self.form not in FORMS or not 0.02 <= self.contact_angle <= 1.4 or not 2 <= self.cells_per_pitch <= 64:
            raise ValueError(
                f"form is {self.form!r}, contact_angle {self.contact_angle}, cells_per_pitch {self.cells_per_pitch}; "
                'needs "linear" or "nonlinear", 0.02 to 1.4 rad, 2 to 64 points'
            )
        self._check_spread(1.0)

    def start(self, height: ArrayLike) -> FineSurface:
        """A continuous fine surface whose cell means are `height` (nx, ny) [m]. Raises ValueError."""
        cells = heights(height)
        columns, rows, rim = (ctypes.c_size_t() for _ in range(3))
        surface = self._struct(cells.shape, None)
        library().inkloop_fine_size(ctypes.byref(surface), columns, rows, rim)
        fine = np.empty((columns.value, rows.value))
        surface.height = reals(fine)
        library().inkloop_spread_cells(ctypes.byref(surface), reals(cells))
        return FineSurface(cells, fine, surface.spacing, int(rim.value))

    def layer(
        self, surface: FineSurface, pattern: ArrayLike, number: int = 1, volume: ArrayLike | None = None
    ) -> FineSurface:
        """The surface after layer `number`; arguments as of `LayerDeposition.layer`, A and B flow alike.

        Raises ValueError, also for droplets that spread over more than two pitches, and InkloopError without memory.
        """
        shape = (surface.height.shape[0], surface.height.shape[1])
        drops = np.where(pattern_of(pattern, shape) > 0, volumes(volume, shape), 0.0)
        self._check_spread(float(drops.max()))
        fine, cells = surface.fine.copy(), np.empty(shape)
        struct = self._struct(shape, fine)
        liquid = LiquidStruct(self.droplet_volume, self.contact_angle, FORMS[self.form])
        colours = pass_colours(self.passes, self.pass_order, self.pass_rotation, number)
        fallbacks, lost = surface.fallbacks, surface.lost
        for line, every in [(colour, len(colours)) for colour in colours] or [(0, 1)]:
            beyond = ctypes.c_double()
            count = library().inkloop_print_lines(
                ctypes.byref(struct), ctypes.byref(liquid), reals(drops), line, every, ctypes.byref(beyond)
            )
            if count == _NO_MEMORY:
                raise InkloopError(f"no memory to solve on {fine.shape[0]} x {fine.shape[1]} points; take fewer")
            fallbacks, lost = fallbacks + count, lost + beyond.value
        library().inkloop_mean_cells(ctypes.byref(struct), reals(cells))
        return FineSurface(cells, fine, surface.spacing, surface.rim, fallbacks, lost)

    def _struct(self, shape: tuple[int, ...], fine: FloatMap | None) -> FineSurfaceStruct:
        spacing = self.pitch / self.cells_per_pitch
        return FineSurfaceStruct(
            shape[0], shape[1], self.cells_per_pitch, spacing, fine if fine is None else reals(fine)
        )

    def _check_spread(self, drops: float) -> None:
        radius = library().inkloop_base_radius(drops * self.droplet_volume, self.contact_angle) if drops > 0.0 else 0.0
        if radius > WIDEST_SPREAD * self.pitch:
            raise ValueError(
                f"a droplet of {drops:g} x {self.droplet_volume:g} m3 spreads to a radius of {radius * UM_PER_M:.1f} "
                f"µm; needs at most {WIDEST_SPREAD} pitches, {WIDEST_SPREAD * self.pitch * UM_PER_M:.1f} µm"
            )
