"""The layer-to-layer model of Lu, Zheng, Mishra (2015), with its larger neighbourhoods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from inkloop.component import FloatMap, Ink
from inkloop.contract import pass_colours
from inkloop_lab.models.grid_arrays import heights, integers, passes_of, pattern_of, reals, volumes
from inkloop_lab.models.library import HEIGHT_COUNT, FarInkStruct, library

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
        inks = (FarInkStruct * 2)(*(FarInkStruct(_padded(ink)) for ink in self.heights))
        lost = surface.lost
        for colour in pass_colours(self.passes, self.pass_order, self.pass_rotation, number) or (-1,):
            before, after = after, np.empty(shape)
            lost += library().inkloop_layer_pass(
                nx, ny, reals(before), reals(after), integers(jetted), inks, self.reach, reals(drops), colour
            )
        return Surface(after, lost)


def _padded(ink: tuple[float, ...]) -> tuple[float, ...]:
    return ink + (0.0,) * (HEIGHT_COUNT - len(ink))
