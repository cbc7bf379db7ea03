"""What the droplets of a layer add to each cell, as a linear function of the ink's three heights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap, Ink
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
    if not order:
        return _of_pass(height, pattern, inks, factor)
    nx, ny = height.shape
    colours = 2 * (np.arange(nx)[:, None] % 2) + np.arange(ny) % 2
    total = DropletIncrements(np.zeros((len(inks), 3, nx, ny)), np.zeros((nx, ny)), np.zeros((nx, ny)))
    for colour in order:
        jetted = np.where(colours == colour, pattern, 0)
        added = _of_pass(height, jetted, inks, factor)
        total = DropletIncrements(total.rates + added.rates, total.squares + added.squares, total.own + added.own)
        height = height + added.added(inks)
    return total


def ink_table(inks: Sequence[Ink]) -> NDArray[np.float64]:
    """(inks, 3): h1, h2, h3 of each [m]."""
    return np.array([[ink.h1, ink.h2, ink.h3] for ink in inks])


def _of_pass(height: FloatMap, pattern: IntMap, inks: Sequence[Ink], factor: FloatMap | None) -> DropletIncrements:
    nx, ny = height.shape
    bare = np.zeros(3)  # no droplet, no spread; its width is never asked for
    table = np.vstack([bare, ink_table(inks)])
    heights = np.stack([of_kind[pattern] for of_kind in table.T]) * (1.0 if factor is None else factor)
    widths = np.where(pattern > 0, heights[0] + heights, 1.0)
    volume = np.where(pattern > 0, 1.0 if factor is None else factor, 0.0)
    beyond = np.pad(height, 1, constant_values=-np.inf)
    rates, squares = np.zeros((len(inks), 3, nx + 2, ny + 2)), np.zeros((nx + 2, ny + 2))
    inside = np.s_[1:-1, 1:-1]
    kept = np.zeros((3, nx, ny))
    kept[0] = volume
    for di in (-1, 0, 1):
        for dj in (-1, 0, 1):
            if di == dj == 0:
                continue
            there = np.s_[1 + di : 1 + di + nx, 1 + dj : 1 + dj + ny]
            kind = 1 if di * dj == 0 else 2
            share = np.clip(1.0 + (height - beyond[there]) / widths[kind], 0.0, 1.0)
            given = share * volume
            kept[kind] += volume - given
            squares[there] += (share * heights[kind]) ** 2
            for ink in range(len(inks)):
                rates[(ink, kind, *there)] += given if len(inks) == 1 else np.where(pattern == ink + 1, given, 0.0)
    own = np.zeros((nx, ny))
    for ink in range(len(inks)):
        mine = np.where(pattern == ink + 1, kept, 0.0)
        rates[(ink, np.s_[:], *inside)] += mine
        own += np.tensordot(table[1 + ink], mine, 1)
    squares[inside] += own**2
    return DropletIncrements(rates[(np.s_[:], np.s_[:], *inside)], squares[inside], own)
