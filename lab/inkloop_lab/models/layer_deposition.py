"""The layer-to-layer model of Lu, Zheng, Mishra (2015) with its larger neighbourhoods, the model without flow that they
compare it with, and the random volumes of droplets, common to all models.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from inkloop.component import FloatMap, Ink
from inkloop.contract import pass_colours
from inkloop_lab.models.library import (
    HEIGHT_COUNT,
    CapStruct,
    FarInkStruct,
    VariationStruct,
    heights,
    integers,
    library,
    passes_of,
    pattern_of,
    positive,
    reals,
    volumes,
)

HEIGHTS_BY_REACH = {1: 3, 2: 6, 3: 10}
"""Cells that a droplet reaches into on each side -> heights that describe it."""
CELLS_OF_HEIGHTS = (1, 4, 4, 4, 8, 4, 4, 8, 8, 4)
"""Cells that get h1, h2, ... h10 of a droplet on flat ground; with them the heights add up to its volume."""


@dataclass(frozen=True, eq=False)
class Surface:
    """height: (nx, ny) [m]; lost: sum of the heights that left over the open edge [m]."""

    height: FloatMap
    lost: float = 0.0


@dataclass(frozen=True)
class LayerDeposition:
    """A droplet on cell p gives a = h2 (side), h3 (corner) ... to each neighbour q, the less the higher q stands:

        q takes a sat(H_p - H_q), p keeps the rest and h1;   sat(b) = clip(1 + b / (h1 + a), 0, 1)

    All H are those before the layer, or before each of its four passes; contributions add; outside the grid lies an
    open edge. heights: per material h1, h2, h3 [m], for a reach of 2 or 3 cells h1 .. h6 or h1 .. h10 (the neighbour
    m cells away along one axis and n <= m along the other has number m (m + 1) / 2 + n, counted from 0). passes,
    pass_order, pass_rotation as in the FMU LayerDeposition. Source: Lu, Zheng, Mishra 2015, equations 3 to 7. Raises
    ValueError.
    """

    heights: tuple[tuple[float, ...], ...] = ((4.4e-6, 0.6e-6, 0.2e-6),)
    passes: int = 1
    pass_order: int = 1
    pass_rotation: int = 0

    def __post_init__(self) -> None:
        passes_of(self.passes, self.pass_order, self.pass_rotation)
        counts = {len(ink) for ink in self.heights}
        if not 1 <= len(self.heights) <= 2 or len(counts) != 1 or not counts <= set(HEIGHTS_BY_REACH.values()):
            raise ValueError(
                f"heights has {[len(ink) for ink in self.heights]} numbers by material; needs 3, 6 or 10 for each of "
                "one or two materials"
            )
        if not all(0.0 <= h < np.inf for ink in self.heights for h in ink):
            raise ValueError(f"heights is {self.heights}; needs heights of at least 0 m")

    @classmethod
    def of(cls, inks: Sequence[Ink], passes: int = 1, pass_order: int = 1, pass_rotation: int = 0) -> LayerDeposition:
        """The model of a job's inks."""
        return cls(tuple((ink.h1, ink.h2, ink.h3) for ink in inks), passes, pass_order, pass_rotation)

    @property
    def reach(self) -> int:
        """Cells that a droplet reaches into on each side."""
        return next(reach for reach, count in HEIGHTS_BY_REACH.items() if count == len(self.heights[0]))

    def start(self, height: ArrayLike) -> Surface:
        """The surface of these heights (nx, ny) [m]. Raises ValueError."""
        return Surface(heights(height))

    def layer(self, surface: Surface, pattern: ArrayLike, number: int = 1, volume: ArrayLike | None = None) -> Surface:
        """The surface after layer `number` (counted from 1).

        pattern: (nx, ny), 0 none, 1 material A, 2 material B; volume: (nx, ny) of each droplet [nominal drops]. Raises
        ValueError.
        """
        after = heights(surface.height)
        nx, ny = shape = (after.shape[0], after.shape[1])
        jetted, drops = pattern_of(pattern, shape), volumes(volume, shape)
        if jetted.max() > len(self.heights):
            raise ValueError("pattern asks for material B; heights has one material")
        inks = (FarInkStruct * 2)(*(FarInkStruct(ink + (0.0,) * (HEIGHT_COUNT - len(ink))) for ink in self.heights))
        lost = surface.lost
        for colour in pass_colours(self.passes, self.pass_order, self.pass_rotation, number) or (-1,):
            before, after = after, np.empty(shape)
            lost += library().inkloop_layer_pass(
                nx, ny, reals(before), reals(after), integers(jetted), inks, self.reach, reals(drops), colour
            )
        return Surface(after, lost)


@dataclass(frozen=True)
class SuperpositionDeposition:
    """A droplet adds the part of its spherical cap that lies over each cell, whatever the surface:

        height_q += volume of the cap over q / pitch^2;   whole cap: pi a (3 r^2 + a^2) / 6

    caps: per material (base radius r, height a) [m], a at most r; pitch [m]. Source: the model of Cohen and Lipson
    (2010) as Lu et al. 2015 state it. Raises ValueError.
    """

    caps: tuple[tuple[float, float], ...] = ((206.5e-6, 4.4e-6),)
    pitch: float = 263.256e-6

    def __post_init__(self) -> None:
        positive(pitch=self.pitch)
        if not 1 <= len(self.caps) <= 2:
            raise ValueError(f"caps has {len(self.caps)} materials; needs one or two")
        limit = (library().inkloop_cap_reach_max() + 0.5) * self.pitch
        for radius, height in self.caps:
            positive(base_radius=radius, height=height)
            if height > radius or radius > limit:
                raise ValueError(
                    f"a cap is {height} m high on a base radius of {radius} m; needs a height of at most the radius, "
                    f"and a radius of at most {limit:g} m, {limit / self.pitch:g} pitches"
                )

    @property
    def layer_height(self) -> float:
        """Mean height that one droplet on every cell adds [m]."""
        radius, height = self.caps[0]
        return math.pi / 6.0 * height * (3.0 * radius**2 + height**2) / self.pitch**2

    def start(self, height: ArrayLike) -> Surface:
        """The surface of these heights (nx, ny) [m]. Raises ValueError."""
        return Surface(heights(height))

    def layer(self, surface: Surface, pattern: ArrayLike, number: int = 1, volume: ArrayLike | None = None) -> Surface:
        """The surface after one more layer, independent of its number; arguments as of `LayerDeposition.layer`."""
        after = heights(surface.height)
        nx, ny = shape = (after.shape[0], after.shape[1])
        jetted, drops = pattern_of(pattern, shape), volumes(volume, shape)
        if jetted.max() > len(self.caps):
            raise ValueError("pattern asks for material B; caps has one material")
        caps = (CapStruct * 2)(*(CapStruct(*cap) for cap in (*self.caps, self.caps[-1])[:2]))
        lost = library().inkloop_caps(nx, ny, reals(after), integers(jetted), caps, self.pitch, reals(drops))
        return Surface(after, surface.lost + lost)


@dataclass(frozen=True)
class DropletVolumes:
    """Factors 1 - U[0, variation] and 1 - U[0, nozzle_variation] by counter-based random numbers (Philox 4x32-10).

    kind: scope of one factor: 1 a droplet, 2 a cell for the whole print, 3 a layer, 4 cell and layer; cell (i, j) is
    jetted by nozzle j modulo nozzle_pitch. The same seed draws the same in every model and FMU. Raises ValueError.
    """

    variation: float = 0.0
    kind: int = 1
    nozzle_variation: float = 0.0
    nozzle_pitch: int = 1
    seed: int = 0

    def __post_init__(self) -> None:
        in_range = all(0.0 <= amplitude <= 1.0 for amplitude in (self.variation, self.nozzle_variation))
        if not in_range or self.kind not in (1, 2, 3, 4) or self.nozzle_pitch < 1:
            raise ValueError(
                f"variation is {self.variation}, nozzle_variation {self.nozzle_variation}, kind {self.kind}, "
                f"nozzle_pitch {self.nozzle_pitch}; needs amplitudes of 0 to 1, a kind of 1 to 4, a nozzle at least"
            )

    def of_layer(self, nx: int, ny: int, number: int) -> FloatMap:
        """(nx, ny): volume of each cell's droplet in layer `number` (counted from 1) [nominal drops]."""
        found = np.empty((nx, ny))
        how = VariationStruct(self.variation, self.kind, self.nozzle_variation, self.nozzle_pitch, self.seed)
        library().inkloop_droplet_volumes(nx, ny, ctypes.byref(how), number, reals(found))
        return found
