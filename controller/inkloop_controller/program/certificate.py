"""Gap of a plan of one layer to the best there is, with proof or with a stated confidence."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import sqrt
from statistics import fmean, stdev
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from inkloop.component import FloatMap
from inkloop.units import M_PER_UM
from inkloop_controller.core.bindings import objective
from inkloop_controller.problem.horizon_problem import HorizonProblem, IntPlan
from inkloop_controller.program.program import HorizonProgram
from inkloop_controller.program.statement import last_surface, numbers_of

WHOLE_MAX = 400  # cells up to which HiGHS gets the grid in one piece; it proves a rough 20x20 in some 10 s (by trial)
TILE = 10  # cells a side (by trial: larger ones are not proven in seconds, smaller ones lose more to their free rims)


@dataclass(frozen=True)
class Certificate:
    """objective: of the plan [m]; bound: no plan has a lower one [m], with the probability `confidence` (1: proven).

    tiles: pieces of the grid, of which tiles_solved were looked at, tiles_proven to the end; seconds: time it took.
    A confidence below 1 is one-sided, by Student's t on the gaps of tiles drawn without replacement: it assumes that
    the mean of that many gaps is nearly normal.
    """

    objective: float
    bound: float
    confidence: float
    tiles: int
    tiles_solved: int
    tiles_proven: int
    seconds: float

    @property
    def gap(self) -> float:
        """The plan is at most this share of its objective above the best [1]."""
        return (self.objective - self.bound) / self.objective if self.objective > 0.0 else 0.0


def certify(
    problem: HorizonProblem,
    plan: IntPlan,
    *,
    confidence: float = 0.95,
    tiles_max: int = 30,
    seconds_max: float = 60.0,
    seed: int = 0,
    whole_max: int = WHOLE_MAX,
    tile: int = TILE,
) -> Certificate:
    """Certify a plan (1, nx, ny) of a problem of one layer in one pass with alpha = 1 and one kind on each cell.

    Up to `whole_max` cells HiGHS gets the whole grid for seconds_max; its bound is proven. Larger grids fall into tiles
    of `tile` cells a side: the least that a tile's cells can cost, with all droplets that reach it free, is less than
    what any plan pays there, so that the sum over all tiles is a bound. It is taken from at most `tiles_max` tiles
    (at least 2), drawn from `seed`, each with its share of seconds_max. Raises ValueError for other problems.
    """
    if problem.layers != 1 or problem.passes != 1 or problem.alpha != 1.0:
        raise ValueError(
            f"certificate of {problem.layers} layers of {problem.passes} passes with alpha {problem.alpha}; "
            "needs 1 layer of 1 pass and alpha = 1: anything else is not linear in the droplets"
        )
    if (problem.choices & (problem.choices - 1)).any():
        raise ValueError("certificate of cells with a choice of kinds; needs at most 1 kind on each cell")
    if not 0.5 <= confidence < 1.0 or tiles_max < 2 or tile < 1:
        raise ValueError(
            f"confidence is {confidence}, tiles_max {tiles_max} and tile {tile}; "
            "needs a confidence from 0.5 to below 1, at least 2 tiles and tiles of at least 1 cell"
        )
    began = time.monotonic()
    value = objective(problem, plan).value
    if problem.part.size <= whole_max:
        found = HorizonProgram(problem, "highs", whole=True, seconds_max=seconds_max).solve(problem)
        bound = max(0.0, found.bound)  # 0 where nothing is known
        return Certificate(value, bound, 1.0, 1, 1, int(found.solved), time.monotonic() - began)
    costs = _costs(problem, plan)
    tiles = list(_tiles(problem, tile))
    drawn = np.random.default_rng(seed).permutation(len(tiles))[:tiles_max]
    program = HorizonProgram(tiles[0][1], "highs", whole=True, seconds_max=seconds_max / len(drawn))
    gaps, proven = [], 0
    for index in drawn:
        place, piece = tiles[index]
        found = program.solve(piece)
        gaps.append(float(costs[place].sum()) - found.bound * piece.part.sum())
        proven += found.solved
    excess = fmean(gaps)
    if len(gaps) < len(tiles):
        unseen = 1.0 - len(gaps) / len(tiles)  # finite population correction
        excess += float(stdtrit(len(gaps) - 1, confidence)) * stdev(gaps) * sqrt(unseen / len(gaps))
    bound = max(0.0, value - excess * len(tiles) / float(problem.part.sum()))
    sure = 1.0 if len(gaps) == len(tiles) else confidence
    return Certificate(value, bound, sure, len(tiles), len(gaps), proven, time.monotonic() - began)


def _costs(problem: HorizonProblem, plan: IntPlan) -> FloatMap:
    """Cost of the plan on every cell (nx, ny) [m]."""
    numbers = numbers_of(problem)
    H = last_surface(numbers, [(layer > 0).astype(float) for layer in plan])
    error = np.asarray(numbers.error(H, lambda x: ca.fmax(x, 0)))
    return np.asarray(problem.weights * error * M_PER_UM, np.float64)


def _tiles(problem: HorizonProblem, side: int) -> Iterator[tuple[tuple[slice, slice], HorizonProblem]]:
    """Place and problem of every tile with cells that count; the problem has a rim of one cell around the tile.

    Beyond the grid lies ground so low that it takes every share in full: an open edge, as the grid's.
    """
    rim = [(1, 1 + (-size) % side) for size in problem.part.shape]

    def padded(array: NDArray[Any], fill: float) -> NDArray[Any]:
        return np.pad(array, rim, constant_values=fill)

    height = padded(problem.height, problem.height.min())
    target, weight = padded(problem.target, problem.height.min()), padded(problem.weights, 0)
    ceiling = None if problem.ceiling is None else padded(problem.ceiling, problem.height.min())
    choices = padded(problem.choices[0], 0)
    inside = np.pad(np.ones((side, side), np.bool_), 1)
    for i in range(0, problem.part.shape[0], side):
        for j in range(0, problem.part.shape[1], side):
            place = (slice(i, i + side), slice(j, j + side))
            around = (slice(i, i + side + 2), slice(j, j + side + 2))
            if problem.weights[place].any():
                yield (
                    place,
                    replace(
                        problem,
                        height=height[around],
                        target=target[around],
                        part=inside,
                        choices=choices[around][None],
                        weight=np.where(inside, weight[around], 0.0),
                        ceiling=None if ceiling is None else ceiling[around],
                    ),
                )
