"""The layer problem with droplets relaxed to 0..1, written in CasADi: a lower bound, and a start to round."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import casadi as ca
import numpy as np

from inkloop.component import BoolMap, FloatMap
from inkloop_controller.layer_model import ink_maps
from inkloop_controller.one_layer import LayerProblem
from inkloop_controller.symbolic_layer import Symbolic, symbolic_layer

Engine: TypeAlias = Literal["ipopt", "highs"]

MICROMETRE = 1e-6  # the solvers work in um
SMOOTHING = 1e-4  # [um2] taken off the variance, so that the flat surface has a gradient; keeps the bound a bound
OPTIONS: dict[Engine, tuple[dict[str, Any], dict[str, Any]]] = {
    "ipopt": (
        {"print_time": False, "error_on_fail": False},
        {"print_level": 0, "sb": "yes", "tol": 1e-9, "max_iter": 300},
    ),
    "highs": ({"print_time": False, "error_on_fail": False}, {"output_flag": False}),
}


@dataclass(frozen=True)
class RelaxedPlan:
    """droplets: (nx, ny) in 0..1; objective: no pattern can have a lower one, if solved [m]."""

    droplets: FloatMap
    objective: float
    solved: bool
    message: str


class LayerRelaxation:
    """One relaxed layer problem for all layers of a print: built once, its values set per layer.

    "ipopt" solves it for any alpha, "highs" as a linear program, which it is for alpha = 1 (else ValueError).
    """

    def __init__(self, part: BoolMap, allowed: BoolMap, alpha: float, engine: Engine) -> None:
        if engine == "highs" and alpha != 1.0:
            raise ValueError(f"relaxation 'highs' with alpha {alpha}; a linear program needs alpha = 1: take 'ipopt'")
        nx, ny = part.shape
        opti = ca.Opti("conic") if engine == "highs" else ca.Opti()

        height = opti.parameter(nx, ny)
        target = opti.parameter(nx, ny)
        h1, h2, h3 = (opti.parameter(nx, ny) for _ in range(3))
        U = opti.variable(nx, ny)
        H = opti.variable(nx, ny)
        error = opti.variable(int(part.sum()))

        opti.subject_to(symbolic_layer(height, U, h1, h2, h3) == H)
        opti.subject_to(
            opti.bounded(0, ca.vec(U), ca.vec(ca.DM(allowed.astype(float))))
        )  # at most one droplet per cell
        opti.subject_to(error >= _over(part, H - target))
        opti.subject_to(error >= _over(part, target - H))
        cost = alpha * ca.sum1(error) / error.numel()
        if alpha < 1.0:
            # Mean and deviation are variables of their own: written inside the objective they would make its Hessian
            # dense. The best free mean is the mean, and the smallest deviation allowed is the deviation.
            mean, deviation = opti.variable(), opti.variable()
            opti.subject_to(deviation >= 0)
            opti.subject_to(ca.sumsqr(_over(part, H) - mean) / error.numel() <= deviation**2 + SMOOTHING)
            opti.set_initial(deviation, 1.0)
            cost += (1.0 - alpha) * deviation
        opti.minimize(cost)
        opti.set_initial(U, 0.5 * allowed)
        opti.solver(engine, *OPTIONS[engine])

        self._opti, self._droplets, self._cost = opti, U, cost
        self._parameters = (height, target, h1, h2, h3)

    def solve(self, problem: LayerProblem) -> RelaxedPlan:
        """Solve for the values of a layer problem of the part, allowed cells and alpha that this was built for."""
        reference = float(problem.height[problem.part].mean())  # only differences of heights count
        maps = (problem.height - reference, problem.target - reference, *ink_maps(problem.inks, problem.material))
        for parameter, values in zip(self._parameters, maps, strict=True):
            self._opti.set_value(parameter, values / MICROMETRE)
        try:
            solution = self._opti.solve_limited()
        except RuntimeError as error:  # CasADi's word for a solver that cannot even start
            return RelaxedPlan(np.zeros(problem.height.shape), np.nan, False, str(error))
        droplets = np.reshape(solution.value(self._droplets), problem.height.shape)
        stats = solution.stats()
        cost = float(solution.value(self._cost)) * MICROMETRE
        return RelaxedPlan(
            np.asarray(np.clip(droplets, 0.0, 1.0), np.float64),
            cost,
            bool(stats["success"]),
            str(stats["return_status"]),
        )


def _over(part: BoolMap, M: Symbolic) -> Symbolic:
    """The part's cells of a map, as a column."""
    column: Any = ca.vec(M)
    return column[np.flatnonzero(part.ravel(order="F")).tolist()]
