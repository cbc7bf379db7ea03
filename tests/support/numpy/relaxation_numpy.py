"""Relaxed droplets and error diffusion, stated in NumPy to check controller/core/relaxation.

The descent takes its cost and slope from the caller, so that nothing of the core is in it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from inkloop.component import FloatMap, Ink
from inkloop_controller.problem.horizon_problem import HorizonProblem, IntPlan

Cost = Callable[[FloatMap, float], tuple[float, FloatMap]]
"""Droplets and smoothing [m] -> smoothed objective [m] and its gradient."""
SMOOTHING = 0.3, 0.003  # first and last, as a share of the height of the largest droplet
SHARES = {(0, 1): 7 / 16, (1, -1): 3 / 16, (1, 0): 5 / 16, (1, 1): 1 / 16}  # Floyd, Steinberg (1976)


def droplet_height(ink: Ink) -> float:
    """Heights that a droplet adds to its nine cells [m]."""
    return ink.h1 + 4.0 * ink.h2 + 4.0 * ink.h3


def levels(problem: HorizonProblem, layer: int, i: int, j: int) -> dict[int, int]:
    """Plan value -> droplets of the first kind allowed that it counts for, at one place."""
    kinds = [k for k in range(len(problem.kinds)) if problem.choices[layer, i, j] >> k & 1]
    heights = [droplet_height(problem.kinds[k]) for k in kinds]
    return {1 + k: max(1, round(height / heights[0])) for k, height in zip(kinds, heights, strict=True)}


def most(problem: HorizonProblem) -> FloatMap:
    """(layers, nx, ny) the largest amount allowed at each place."""
    found = np.zeros(problem.choices.shape)
    for place in np.ndindex(found.shape):
        found[place] = max(levels(problem, *place).values(), default=0)
    return found


def smoothings(problem: HorizonProblem) -> tuple[float, float]:
    """The first and the last [m]."""
    first, last = (share * max(map(droplet_height, problem.kinds)) for share in SMOOTHING)
    return first, last


def step(problem: HorizonProblem, smoothing: float) -> float:
    """The inverse curvature of the smoothed cost [1/m]."""
    unit = max(map(droplet_height, problem.kinds))
    return float(smoothing * problem.part.sum() / (unit**2 * problem.layers))


def relaxed(problem: HorizonProblem, start: FloatMap, iterations: int, cost: Cost) -> tuple[FloatMap, float]:
    """Nesterov's descent within the limits, restarted where the momentum leads uphill (O'Donoghue, Candes 2015).

    The smoothing falls in a geometric sequence; a step is its inverse curvature. The better of start and end.
    """
    limit, (first, last) = most(problem), smoothings(problem)
    droplets = np.clip(start, 0.0, limit)
    begin, ahead, t = droplets, droplets, 1.0
    for k in range(iterations):
        smoothing = first * (last / first) ** (k / iterations)
        _, gradient = cost(ahead, smoothing)
        moved = np.clip(ahead - step(problem, smoothing) * gradient, 0.0, limit)
        if np.sum(gradient * (moved - droplets)) > 0.0:
            droplets, ahead, t = moved, moved, 1.0
        else:
            t, before = (1.0 + np.sqrt(1.0 + 4.0 * t**2)) / 2.0, t
            droplets, ahead = moved, np.clip(moved + (before - 1.0) / t * (moved - droplets), 0.0, limit)
    return min(((each, cost(each, last)[0]) for each in (droplets, begin)), key=lambda pair: pair[1])


def diffused(problem: HorizonProblem, droplets: FloatMap) -> IntPlan:
    """Floyd and Steinberg's error diffusion over the sum of the layers, row by row, every other one backwards.

    A cell takes the nearest whole number that its layers can hold: one droplet in each layer, the last ones first, and
    what exceeds that evenly; what is left of its wish goes to the cells to come that may have droplets at all, in
    proportion to the four shares.
    """
    limit, plan = most(problem), np.zeros(problem.choices.shape, np.int32)
    wish, room = np.minimum(droplets, limit).sum(axis=0), limit.sum(axis=0)
    nx, ny = room.shape
    for i in range(nx):
        way = -1 if i % 2 else 1
        for j in range(ny)[::way]:
            left = float(np.clip(np.floor(wish[i, j] + 0.5), 0.0, room[i, j]))
            rest = wish[i, j]
            usable = [layer for layer in range(len(plan)) if problem.choices[layer, i, j]]
            for before, layer in reversed(list(enumerate(usable))):
                even = min(left, max(1.0, left // (before + 1)))
                fitting = {value: size for value, size in levels(problem, layer, i, j).items() if size <= even}
                if fitting:
                    plan[layer, i, j] = max(fitting, key=lambda value: (fitting[value], -value))
                    left, rest = (amount - fitting[int(plan[layer, i, j])] for amount in (left, rest))
            to = {(i + di, j + way * dj): share for (di, dj), share in SHARES.items()}
            open_to = {at: s for at, s in to.items() if at[0] < nx and 0 <= at[1] < ny and room[at] > 0.0}
            for at, share in open_to.items():
                wish[at] += rest * share / sum(open_to.values())
    return plan


def dithered(problem: HorizonProblem, droplets: FloatMap) -> IntPlan:
    """The droplets of a single layer, rounded by Bayer's thresholds (1973), which repeat every four cells."""
    pattern = np.zeros((1, 1))
    for _ in range(2):
        pattern = np.block([[4 * pattern, 4 * pattern + 2], [4 * pattern + 3, 4 * pattern + 1]])
    i, j = np.indices(problem.part.shape)
    falls = droplets > (pattern[i % 4, j % 4] + 0.5) / 16
    lowest = problem.choices & -problem.choices.astype(np.int32)
    return np.where(falls & (problem.choices > 0), np.log2(np.maximum(lowest, 1)) + 1, 0).astype(np.int32)
