"""What the droplets of a layer add to each cell, as a linear function of the ink's three heights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap, Ink
from inkloop_controller.core import checked, ink_pair, layer_struct, pointer
from inkloop_controller.core_library import IncrementsStruct, library
from inkloop_controller.horizon_problem import IntMap


@dataclass(frozen=True)
class DropletIncrements:
    """rates: (inks, 3, nx, ny), height added per metre of h1, h2, h3 of each ink [1], for given widths of saturation;
    squares: (nx, ny), sum over the droplets of the square of what each adds [m^2]; own: (nx, ny), what the cell's own
    droplet leaves on it [m], with the heights of the ink that the widths are of.
    """

    rates: NDArray[np.float64]
    squares: FloatMap
    own: FloatMap

    def added(self, inks: Sequence[Ink]) -> FloatMap:
        """(nx, ny) height that the droplets add [m] with the heights of `inks`."""
        return np.asarray(np.tensordot(ink_table(inks), self.rates))


def droplet_increments(
    height: FloatMap, pattern: IntMap, inks: Sequence[Ink], order: Sequence[int] = (), factor: FloatMap | None = None
) -> DropletIncrements:
    """The increments of one layer, widths of saturation from `inks` (Lu, Zheng, Mishra 2015, eq. 3-7), open edge.

    height: (nx, ny) before the layer [m]; pattern: (nx, ny), 0 none, 1 + index of the ink; order: colours of the four
    passes (empty: one pass); factor: (nx, ny) volume of each droplet [1].
    """
    shape = np.shape(height)
    surface, jetted = checked("height", height, "f8", shape), checked("pattern", pattern, "i4", shape)
    volumes = None if factor is None else checked("factor", factor, "f8", shape)
    found = DropletIncrements(np.empty((len(inks), 3, *shape)), np.empty(shape), np.empty(shape))
    library().inkloop_droplet_increments(
        layer_struct(jetted, order, volumes),
        pointer(surface),
        len(inks),
        ink_pair(inks),
        pointer(np.empty((2, *shape))),
        IncrementsStruct(pointer(found.rates), pointer(found.squares), pointer(found.own)),
    )
    return found


def ink_table(inks: Sequence[Ink]) -> NDArray[np.float64]:
    """(inks, 3): h1, h2, h3 of each [m]."""
    return np.array([[ink.h1, ink.h2, ink.h3] for ink in inks])
