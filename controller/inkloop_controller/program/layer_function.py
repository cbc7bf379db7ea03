"""The layer problem as a CasADi function of droplets, in metres, for a solver of one's own.

Inputs by name, of a problem of nx * ny cells, `layers` and `kinds` of droplets:

    droplets      (nx, layers * kinds * ny)   maps side by side: layer 1 kind 1, layer 1 kind 2, ..., layer 2 kind 1
                                              1 where such a droplet falls, 0 where none does, or anything between
    height        (nx, ny)                    the surface before the first layer [m]
    target        (nx, ny)                    [m]
    weight        (nx, ny)                    of each cell's error [1]
    ceiling       (nx, ny)                    [m]; only of a problem that has one
    ink           (kinds, 3)                  h1, h2, h3 of each kind [m]
    alpha, overshoot, ceiling_cost, droplet_std   as in HorizonProblem

Outputs: objective [m] = alpha (error + over_ceiling) + (1 - alpha) deviation, as the search in C counts it, these three
parts [m], and surface (nx, ny) [m] after the last layer. Part, layers, passes and kinds are those of the problem that
the function was made of. An input that is left out is NaN, and so is the objective.
"""

from __future__ import annotations

from math import nan, sqrt
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from inkloop_controller.problem.horizon_problem import HorizonProblem, IntPlan
from inkloop_controller.program.statement import Symbolic, jetted_maps, over, symbolic_shares, variance

NO_CHANCE_M = 1e-30  # instead of 0 where a division by it makes 0 of 0
FLAT_M2 = 1e-36  # added to the variance, so that a flat surface has a gradient
MAPS = ("height", "target", "weight", "ceiling")
NUMBERS = ("alpha", "overshoot", "ceiling_cost", "droplet_std")


def layer_function(problem: HorizonProblem) -> Any:
    """The function, for all problems with the part, layers, passes and kinds of this one."""
    shape, kinds = problem.part.shape, len(problem.kinds)
    values = layer_values(problem)
    droplets = ca.MX.sym("droplets", shape[0], problem.layers * kinds * shape[1])
    given = {name: ca.MX.sym(name, *np.shape(value)) for name, value in values.items()}
    maps = ca.horzsplit(droplets, shape[1])
    inks = [ca.horzsplit(ink) for ink in ca.vertsplit(given["ink"])]
    H, kept = given["height"], ca.DM.zeros(shape)
    for layer, passes in enumerate(jetted_maps(problem)):
        for jetted in passes:
            H, kept = jet_kinds(H, [jetted * U for U in maps[layer * kinds : (layer + 1) * kinds]], inks)
    least = ca.mmin(given["ink"][:, 0])
    chance = sqrt(3.0) * given["droplet_std"] * ca.fmax(kept, least)
    error, over_ceiling, deviation = _parts(problem, given, H, chance)
    objective = given["alpha"] * (error + over_ceiling) + (1 - given["alpha"]) * deviation
    return ca.Function(
        "layer_problem",
        [droplets, *given.values()],
        [objective, error, over_ceiling, deviation, H],
        ["droplets", *given],
        ["objective", "error", "over_ceiling", "deviation", "surface"],
        {"default_in": [nan] * (1 + len(given))},
    )


def layer_values(problem: HorizonProblem) -> dict[str, Any]:
    """The values of a problem by the names of the inputs; all but the droplets."""
    maps = {"height": problem.height, "target": problem.target, "weight": problem.weights, "ceiling": problem.ceiling}
    ink = np.array([[kind.h1, kind.h2, kind.h3] for kind in problem.kinds])
    numbers = {name: getattr(problem, name) for name in NUMBERS}
    return {**{name: value for name, value in maps.items() if value is not None}, "ink": ink, **numbers}


def droplets_of(problem: HorizonProblem, plan: IntPlan) -> NDArray[np.float64]:
    """The input `droplets` of a plan (layers, nx, ny)."""
    kinds = range(1, 1 + len(problem.kinds))
    return np.hstack([np.asarray(layer == kind, np.float64) for layer in plan for kind in kinds])


def jet_kinds(H: Symbolic, droplets: list[Symbolic], inks: list[Any]) -> tuple[Symbolic, Symbolic]:
    """Surface after one pass of droplets of several kinds over H, and what they leave on their own cells."""
    after, left = H, ca.DM.zeros(H.shape)
    for U, (h1, h2, h3) in zip(droplets, inks, strict=True):
        kept, taken = symbolic_shares(H, U, h1, h2, h3)
        after, left = after + kept + taken, left + kept
    return after, left


def expected_size(error: Symbolic, chance: Symbolic) -> Symbolic:
    """Mean of |e| for an error e that is uniform within `chance` w: |e|, or (e^2 / w + w) / 2 where that is more."""
    size = ca.fabs(error)
    return size + (chance - ca.fmin(size, chance)) ** 2 / (2 * chance)


def _parts(problem: HorizonProblem, given: dict[str, Any], H: Symbolic, chance: Symbolic) -> tuple[Any, Any, Any]:
    """Error, what is above the ceiling, and deviation of the surface H left to `chance` (controller/core/search)."""
    cells, error = int(problem.part.sum()), H - given["target"]
    upward, skew = (given["overshoot"] + 1) / 2, (given["overshoot"] - 1) / 2
    costs = upward * expected_size(error, chance + NO_CHANCE_M) + skew * error
    above = ca.DM.zeros(H.shape)
    if problem.ceiling is not None:
        above = (H - given["ceiling"] + ca.fabs(H - given["ceiling"])) / 2  # fmax would make 0 of NaN
    weight = given["weight"]
    squares = ca.sumsqr(over(problem.part, chance)) / (3 * cells)
    return (
        ca.sum1(ca.sum2(weight * costs)) / cells,
        given["ceiling_cost"] * ca.sum1(ca.sum2(weight * above)) / cells,
        ca.sqrt(variance(over(problem.part, H)) + squares + FLAT_M2),
    )
