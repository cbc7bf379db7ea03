"""The stochastic greedy search of Lu, Zheng, Mishra (2015, IV-C) as one would first write it: every trial flip
evaluates the whole layer. The peer of the search core."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from time import monotonic

import numpy as np
from numpy.typing import NDArray

FloatMap = NDArray[np.float64]
Pattern = NDArray[np.int32]


def naive_search(
    objective: Callable[[Pattern], float],
    start: Pattern,
    batch: int,
    rng: np.random.Generator,
    seconds_max: float = inf,
) -> Pattern:
    """Best pattern, or plan, found from `start` by flips in random batches of at most `batch` cells.

    A batch that raises the objective although each of its flips lowers it is undone and the batch size halved;
    the search ends when every single flip has been tried in vain, or after `seconds_max`.
    """
    end = monotonic() + seconds_max
    pattern, best = start.copy(), objective(start)
    order: list[int] = []
    while monotonic() < end:
        if not order:
            order, improved = rng.permutation(pattern.size).tolist(), False
        cells, order = order[:batch], order[batch:]
        marked = [cell for cell in cells if objective(_flipped(pattern, [cell])) < best]
        trial = _flipped(pattern, marked)
        value = objective(trial) if marked else best
        if value < best:
            pattern, best, improved = trial, value, True
        elif marked and batch > 1:
            batch, improved = batch // 2, True
        if not order and not improved:
            break
    return pattern


def _flipped(pattern: Pattern, cells: list[int]) -> Pattern:
    changed = pattern.copy()
    changed.flat[cells] = 1 - changed.flat[cells]
    return changed
