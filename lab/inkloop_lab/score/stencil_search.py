"""A controller that plans one layer ahead with a stencil of any reach, to judge a stencil by its closed loop."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap, FloatMap, Job
from inkloop.units import M_PER_UM
from inkloop_lab.models import LayerDeposition

Pattern = NDArray[np.int32]
Cell = tuple[int, int]

GAIN_M = 1e-12
"""Least decrease of the objective by a change: above rounding, far below a droplet."""


class StencilSearch:
    """Droplets of one layer are added, taken away and moved by one cell as long as that lowers the objective.

    It is that of LayerMpc for a horizon of 1, alpha mean|target - height| + (1 - alpha) std(height) over the part, of
    the surface that the layer-to-layer model predicts. Nothing is learnt while it prints. heights_um: h1, h2, h3, or 6
    or 10 heights of a reach of 2 or 3 cells, none: those of the job's ink. Raises ValueError, also for two inks.
    """

    def __init__(self, job: Job, *, heights_um: tuple[float, ...] = (), alpha: float = 0.8) -> None:
        if len(job.inks) > 1:
            raise ValueError(f"the job has {len(job.inks)} inks; this controller prints one")
        ink = job.inks[0]
        heights = tuple(float(height) * M_PER_UM for height in heights_um) or (ink.h1, ink.h2, ink.h3)
        self._model = LayerDeposition((heights,), job.passes, job.pass_order, job.pass_rotation)
        self._job, self._alpha = job, alpha
        self._cells: list[Cell] = [(int(i), int(j)) for i, j in np.argwhere(job.mask)]
        self._pairs = _neighbours(job.mask)

    def pattern(self, height: FloatMap, layer: int) -> Pattern:
        """The better one (nx, ny) of those found from a full layer and from droplets where half of one is missing;
        empty where nothing printed is better.
        """
        job, surface = self._job, self._model.start(height)
        target = job.target_height[job.mask]

        def objective(pattern: Pattern) -> float:
            after = self._model.layer(surface, pattern, layer + 1).height[job.mask]
            return float(self._alpha * np.abs(target - after).mean() + (1.0 - self._alpha) * after.std())

        missing = job.mask & (job.target_height - height > 0.5 * job.inks[0].layer_height)
        best = np.zeros(job.mask.shape, np.int32)
        for start in (job.mask, missing):
            found = start.astype(np.int32)
            _descend(found, objective, self._cells, self._pairs)
            best = min(best, found, key=objective)
        return best


def _descend(
    pattern: Pattern,
    objective: Callable[[Pattern], float],
    cells: Sequence[Cell],
    pairs: Sequence[tuple[Cell, Cell]],
) -> None:
    """Change a pattern in place until no droplet more, less or moved to a neighbour lowers its objective [m]."""
    least = objective(pattern)

    def improves(*places: Cell) -> bool:
        nonlocal least
        for place in places:
            pattern[place] ^= 1
        if (tried := objective(pattern)) < least - GAIN_M:
            least = tried
            return True
        for place in places:
            pattern[place] ^= 1
        return False

    moved = 1
    while moved:
        while sum(improves(cell) for cell in cells):
            pass
        moved = sum(improves(one, other) for one, other in pairs if pattern[one] != pattern[other])


def _neighbours(part: BoolMap) -> list[tuple[Cell, Cell]]:
    """Pairs of cells of the part that touch by a side or a corner."""
    nx, ny = part.shape
    steps = ((1, 0), (0, 1), (1, 1), (1, -1))
    found = [
        ((i, j), (i + di, j + dj))
        for (i, j), (di, dj) in product(product(range(nx), range(ny)), steps)
        if i + di < nx and 0 <= j + dj < ny
    ]
    return [(one, other) for one, other in found if part[one] and part[other]]
