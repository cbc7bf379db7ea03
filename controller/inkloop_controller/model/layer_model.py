"""The prediction model: the surface after a pattern."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from inkloop.component import FloatMap, Ink, Job
from inkloop.contract import PassOrder, pass_colours
from inkloop_controller.core import bindings
from inkloop_controller.problem.horizon_problem import IntMap

if TYPE_CHECKING:
    from inkloop_controller.program.statement import Symbolic


@dataclass(frozen=True)
class LayerModel:
    """Layer-to-layer map of the inks, in one pass or four (Lu, Zheng, Mishra 2015, III and V-D).

    passes, pass_order, pass_rotation as in LayerDeposition: layer n starts pass_rotation * n positions later.
    Raises ValueError for passes and orders that there are not.
    """

    inks: tuple[Ink, ...]
    passes: int = 1
    pass_order: int = 1
    pass_rotation: int = 0

    def __post_init__(self) -> None:
        if self.passes not in (1, 4) or self.pass_order not in tuple(PassOrder):
            raise ValueError(
                f"passes is {self.passes} and pass_order {self.pass_order}; "
                "needs 1 or 4 passes in order 1 (raster) or 2 (diagonal)"
            )

    @classmethod
    def of(cls, job: Job) -> LayerModel:
        """The model that the job describes."""
        return cls(job.inks, job.passes, job.pass_order, job.pass_rotation)

    def scaled(self, ink_scale: float) -> LayerModel:
        """The model for droplets of `ink_scale` times the nominal volume [1]."""
        inks = tuple(Ink(ink_scale * ink.h1, ink_scale * ink.h2, ink_scale * ink.h3) for ink in self.inks)
        return replace(self, inks=inks)

    def layer(self, height: FloatMap, pattern: IntMap, number: int = 1, factor: FloatMap | None = None) -> FloatMap:
        """Surface [m] after layer `number` (counted from 1).

        height: (nx, ny) [m]; pattern: (nx, ny), 0 none, 1 material A, 2 material B; factor: (nx, ny), volume of each
        droplet as a share of the nominal one [1].
        """
        return bindings.layer(height, pattern, self.inks, self.colours(number), factor)

    def symbolic(self, H: Symbolic, U: Symbolic, material: IntMap | None = None) -> Symbolic:
        """The same map in CasADi for one pass: H (nx, ny) [m], U (nx, ny) relaxed to 0..1, material of each cell."""
        from inkloop_controller.program.statement import symbolic_layer

        if self.passes != 1:
            raise ValueError(f"passes is {self.passes}; the symbolic map is written for one pass")
        chosen = np.zeros(H.shape, np.int32) if material is None else material
        return symbolic_layer(H, U, *ink_maps(self.inks, chosen))

    def colours(self, number: int) -> tuple[int, ...]:
        """Colours in the order in which layer `number` jets them; none in one pass."""
        return pass_colours(self.passes, self.pass_order, self.pass_rotation, number)


def ink_maps(inks: tuple[Ink, ...], material: IntMap) -> tuple[FloatMap, FloatMap, FloatMap]:
    """h1, h2, h3 [m] of a droplet on each cell, (nx, ny) each."""
    table = np.array([[ink.h1, ink.h2, ink.h3] for ink in inks])
    h1, h2, h3 = np.moveaxis(table[material], -1, 0)
    return h1, h2, h3
