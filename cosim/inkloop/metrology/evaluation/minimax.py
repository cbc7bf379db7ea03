"""The best fit in the sense of Chebyshev: factors of given terms with the smallest largest distance.

Minimum zone planes, steps, circles and walls are such fits. The linear program is solved on few of the points; those
with the largest errors are added until none exceeds the zone, so that its size does not depend on that of the map.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_JOIN = 8
"""Points of each side added at a time."""
_EXACT = 1e-9
"""Tolerance of a solution, as a share of the zone."""
_ROUNDS = 200


def minimax(terms: NDArray[np.float64], values: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """The factors (k,) and the half width of the zone: max |values - terms @ factors| is as small as it can be.

    terms: (N, k); values: (N,). Of several best fits one is returned; the zone is unique.
    """
    from scipy.optimize import linprog

    scale = np.abs(terms).max(axis=0)
    columns = terms / np.where(scale > 0.0, scale, 1.0)
    factors = np.linalg.lstsq(columns, values, rcond=None)[0]
    rest = values - columns @ factors
    unit = float(np.abs(rest).max())
    if unit <= 1e-14 * float(np.abs(values).max(initial=0.0)):
        return factors / np.where(scale > 0.0, scale, 1.0), unit
    rest = rest / unit
    chosen, shift = _extremes(columns), np.zeros(terms.shape[1])
    cost = np.append(np.zeros(terms.shape[1]), 1.0)
    bounds = [(None, None)] * terms.shape[1] + [(0.0, None)]
    for _ in range(_ROUNDS):
        missed = rest - columns @ shift
        order = np.argpartition(missed, (min(_JOIN, missed.size - 1), max(missed.size - 1 - _JOIN, 0)))
        chosen = np.union1d(chosen, np.concatenate([order[:_JOIN], order[-_JOIN:]]))
        own, ones = columns[chosen], np.ones((chosen.size, 1))
        solved = linprog(
            cost,
            A_ub=np.block([[-own, -ones], [own, -ones]]),
            b_ub=np.concatenate([-rest[chosen], rest[chosen]]),
            bounds=bounds,
            options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
        )
        shift, zone = solved.x[:-1], float(solved.x[-1])
        largest = float(np.abs(rest - columns @ shift).max())
        if largest <= zone + _EXACT:
            break
    return (factors + unit * shift) / np.where(scale > 0.0, scale, 1.0), unit * largest


def _extremes(columns: NDArray[np.float64]) -> NDArray[np.int64]:
    """The points where a term is largest or smallest."""
    return np.unique(np.concatenate([np.argmax(columns, axis=0), np.argmin(columns, axis=0)]))
