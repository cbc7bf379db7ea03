"""The smoothed objective of the relaxation, by the statement in CasADi."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from inkloop.component import FloatMap
from inkloop.units import M_PER_UM
from inkloop_controller.problem.horizon_problem import HorizonProblem
from inkloop_controller.program.statement import last_surface, numbers_of, variance


def smoothed_cost(problem: HorizonProblem) -> Callable[[FloatMap, float], tuple[float, FloatMap]]:
    """Droplets (layers, nx, ny) and smoothing [m] -> objective [m] and its gradient (layers, nx, ny) [m per droplet].

    Smoothing s: max(x, 0) becomes (x + sqrt(x^2 + s^2)) / 2, the standard deviation sqrt(variance + s^2).
    """
    statement, s = numbers_of(problem), ca.MX.sym("s")
    U = [ca.MX.sym("U", *problem.part.shape) for _ in range(problem.layers)]
    cost = statement.cost(
        last_surface(statement, U),
        positive_part=lambda x: (x + ca.sqrt(x**2 + s**2)) / 2,
        deviation=lambda cells: ca.sqrt(variance(cells) + s**2),
    )
    evaluate = ca.Function("smoothed_cost", [s, *U], [cost, *(ca.gradient(cost, layer) for layer in U)])

    def valued(droplets: FloatMap, smoothing: float) -> tuple[float, FloatMap]:
        value, *gradient = evaluate(smoothing / M_PER_UM, *droplets)
        return float(value) * M_PER_UM, np.stack([np.asarray(layer) for layer in gradient]) * M_PER_UM

    return valued
