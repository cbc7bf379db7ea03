"""Flatness, parallelism to the substrate and step height (ISO 1101, ISO 12781, ISO 5436-1), each by two methods.

Least squares (`_ls`): the reference is the plane with the smallest sum of squared distances. Minimum zone (`_mz`): the
two parallel planes with the smallest distance that enclose all points. Distances are taken along z and multiplied by
the cosine of the tilt. Minimum zones are fits in the sense of Chebyshev: the linear program is solved on few of the
points; those with the largest errors are added until none exceeds the zone, so that its size does not depend on that of
the map.

    flatness      range of the top above its plane
    parallelism   range of the top above the plane of the substrate
    step height   h of z = a + b x + c y + h [on the top], one fit to the substrate and the central third of the top
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap, FloatMap
from inkloop.metrology.evaluation.surface import CELLS_MIN, Found, Refusal, refused

EDGE = 2
"""Cells around the part that are no substrate: droplets reach there (assumed)."""
CENTRE = 2.0 / 3.0
"""Share of the largest distance to the edge above which a cell is in the central third of its face (ISO 5436-1)."""
STANDS_OUT = 3.0
"""Least step, in standard deviations of the distances to its two planes (assumed)."""
_JOIN = 8
"""Points of each side added at a time."""
_EXACT = 1e-9
"""Tolerance of a solution, as a share of the zone."""
_ROUNDS = 200


@dataclass(frozen=True, eq=False)
class Points:
    """(N,) places x, y and heights z [m] of one face."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    z: NDArray[np.float64]

    @classmethod
    def of(cls, z: FloatMap, cells: BoolMap, dx: float, dy: float) -> Points:
        """The chosen cells of a map."""
        i, j = np.nonzero(cells)
        return cls(np.asarray(i * dx, np.float64), np.asarray(j * dy, np.float64), z[cells])

    @property
    def plane_terms(self) -> NDArray[np.float64]:
        """(N, 3): 1, x, y."""
        return np.stack([np.ones_like(self.x), self.x, self.y], axis=-1)


def central_third(cells: BoolMap, sizes: tuple[float, float]) -> BoolMap:
    """The cells of a face that are far from its edge: the middle third of its width."""
    from scipy.ndimage import distance_transform_edt

    distance = distance_transform_edt(np.pad(cells, 1), sampling=sizes)[1:-1, 1:-1]
    return np.asarray(cells & (distance >= CENTRE * distance.max()), np.bool_)


def flatness(top: Points) -> Found:
    """flatness_ls, flatness_mz [m]."""
    terms, found = top.plane_terms, {}
    if np.linalg.matrix_rank(terms - terms.mean(axis=0)) < 2:
        return refused(("flatness_ls", "flatness_mz"), "the cells lie on one line and define no plane")
    plane = _least_squares(terms, top.z)
    found["flatness_ls"] = float(np.ptp(top.z - terms @ plane)) * _cosine(plane)
    plane, half = minimax(terms, top.z)
    found["flatness_mz"] = 2.0 * half * _cosine(plane)
    return found


def parallelism(top: Points, substrate: Points | Refusal) -> Found:
    """parallelism_ls, parallelism_mz [m]: by method of the plane of the substrate."""
    symbols = ("parallelism_ls", "parallelism_mz")
    if isinstance(substrate, Refusal):
        return refused(symbols, substrate.reason)
    terms = substrate.plane_terms
    planes = (_least_squares(terms, substrate.z), minimax(terms, substrate.z)[0])
    rises = [np.ptp(top.z - top.plane_terms @ plane) * _cosine(plane) for plane in planes]
    return dict(zip(symbols, map(float, rises), strict=True))


@dataclass(frozen=True, eq=False)
class Step:
    """Heights of a step by both methods [m], and the plane of the substrate (1, x, y) by least squares."""

    ls: float
    mz: float
    substrate: NDArray[np.float64]


def step(inner: Points, substrate: Points | Refusal, target: NDArray[np.float64] | None) -> Step | Refusal:
    """The step from the substrate to the inner cells of the top; target: their nominal heights, if known."""
    if isinstance(substrate, Refusal):
        return substrate
    if inner.z.size < CELLS_MIN:
        return Refusal(
            f"{inner.z.size} cells with heights lie in the central third of the part; a step needs {CELLS_MIN}"
        )
    if target is not None and np.ptp(target) > 1e-5 * np.abs(target).max():
        return Refusal("the target is not flat: its top has no single height above the substrate")
    terms = np.concatenate([substrate.plane_terms, inner.plane_terms])
    is_top = np.concatenate([np.zeros(substrate.z.size), np.ones(inner.z.size)])
    terms, z = np.column_stack([terms, is_top]), np.concatenate([substrate.z, inner.z])
    fitted = _least_squares(terms, z)
    scatter = float(np.std(z - terms @ fitted))
    if not fitted[3] > STANDS_OUT * scatter:
        return Refusal("no step stands out: the heights scatter by more than a third of the rise from the substrate")
    best = minimax(terms, z)[0]
    return Step(float(fitted[3]) * _cosine(fitted), float(best[3]) * _cosine(best), fitted[:3])


def step_height(found: Step | Refusal) -> Found:
    """step_height_ls, step_height_mz [m]."""
    symbols = ("step_height_ls", "step_height_mz")
    if isinstance(found, Refusal):
        return refused(symbols, found.reason)
    return dict(zip(symbols, (found.ls, found.mz), strict=True))


def _least_squares(terms: NDArray[np.float64], z: NDArray[np.float64]) -> NDArray[np.float64]:
    scale = np.abs(terms).max(axis=0)
    scale[scale == 0.0] = 1.0
    return np.asarray(np.linalg.lstsq(terms / scale, z, rcond=None)[0] / scale, np.float64)


def _cosine(plane: NDArray[np.float64]) -> float:
    return float(1.0 / np.sqrt(1.0 + plane[1] ** 2 + plane[2] ** 2))


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
