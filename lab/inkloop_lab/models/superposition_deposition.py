"""Spherical caps added up, no flow: the traditional model that Lu, Zheng, Mishra (2015) compare theirs with."""

from __future__ import annotations

import math
from dataclasses import dataclass

from numpy.typing import ArrayLike

from inkloop_lab.models.grid_arrays import heights, integers, pattern_of, positive, reals, volumes
from inkloop_lab.models.layer_deposition import Surface
from inkloop_lab.models.library import CapStruct, library


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
