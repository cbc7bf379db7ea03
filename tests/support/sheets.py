"""A region of many intervals on every cell: sheets over each other, that move up from cell to cell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from inkloop.component import BoolMap, FloatMap, HeightIntervals
from inkloop.geometry import contained


@dataclass(frozen=True)
class Sheets:
    """Sheets from `bottoms` up, each of the same thickness [m], in any order; they may overlap.

    rise: what each begins higher per metre along x. height: of the block that they stand in [m].
    """

    bottoms: Sequence[float]
    thickness: float
    rise: float = 0.0
    height: float = 0.0

    def contains(self, x: FloatMap, y: FloatMap, z: FloatMap) -> BoolMap:
        return contained(self.intervals(x, y), z)

    def intervals(self, x: FloatMap, y: FloatMap) -> HeightIntervals:
        starts = [np.add(at, self.rise * x) for at in self.bottoms]
        return [(start, start + self.thickness) for start in starts]

    def top(self, x: FloatMap, y: FloatMap) -> FloatMap:
        return np.full_like(x, self.height)
