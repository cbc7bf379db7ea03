"""Regions for prints in two inks, as simple as they can be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inkloop.component import BoolMap, FloatMap, HeightIntervals


@dataclass(frozen=True)
class Above:
    """Everything above a height [m]."""

    z: float

    def contains(self, x: FloatMap, y: FloatMap, z: FloatMap) -> BoolMap:
        return np.broadcast_to(z > self.z, np.broadcast_shapes(x.shape, z.shape))

    def intervals(self, x: FloatMap, y: FloatMap) -> HeightIntervals:
        return ((np.full_like(x, np.nextafter(self.z, np.inf)), np.full_like(x, np.inf)),)


@dataclass(frozen=True)
class Below:
    """Everything below a height [m]."""

    z: float

    def contains(self, x: FloatMap, y: FloatMap, z: FloatMap) -> BoolMap:
        return np.broadcast_to(z < self.z, np.broadcast_shapes(x.shape, z.shape))

    def intervals(self, x: FloatMap, y: FloatMap) -> HeightIntervals:
        return ((np.full_like(x, -np.inf), np.full_like(x, np.nextafter(self.z, -np.inf))),)
