"""The layer problem as a program for IPOPT or HiGHS, built once and solved for many values."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, nan
from typing import Any, Literal, TypeAlias

import casadi as ca
import numpy as np

from inkloop.component import BoolMap, FloatMap
from inkloop.units import M_PER_UM
from inkloop_controller.problem.horizon_problem import HorizonProblem
from inkloop_controller.program.statement import (
    HorizonStatement,
    LayerSymbols,
    Symbolic,
    exact_cost,
    jet,
    numbers_of,
)

Engine: TypeAlias = Literal["ipopt", "highs"]

SMOOTHING = 1e-4  # [um2] taken off the variance, so that the flat surface has a gradient; keeps the bound a bound
TOLERANCE = 2e-6  # [um] by which HiGHS may overrate a bound: its feasibility tolerances, 1e-6 for each of two rows


@dataclass(frozen=True, eq=False)
class RelaxedPlan:
    """Droplets of any size (layers, nx, ny), counted in droplets of the first kind allowed on a cell.

    value: objective of these droplets [m]; bound: no plan has a lower one [m], nan if the problem is not convex or was
    not solved; solved: the solver reports that it has found an optimum (of a longer horizon: a local one).
    """

    droplets: FloatMap
    value: float
    bound: float
    solved: bool
    message: str


class HorizonProgram:
    """The relaxed layer problem for all layers of a print: built once for a grid, part, horizon and passes.

    "ipopt" solves it for any alpha and horizon. "highs" takes a horizon of one layer in one pass with alpha = 1, which
    is a linear program; `whole` droplets make it a mixed-integer one, which ends after `seconds_max` with what it has.
    For one layer in one pass the problem is convex, and its optimum a bound on every plan with one kind of droplet on
    each cell; over more steps it is not, and IPOPT's optimum is only a local one. Raises ValueError where an engine
    does not apply.
    """

    def __init__(self, like: HorizonProblem, engine: Engine, *, whole: bool = False, seconds_max: float = inf) -> None:
        linear = like.layers == like.passes == 1 and like.alpha == 1.0
        if engine == "highs" and not linear:
            raise ValueError(
                f"engine 'highs' with {like.layers} layers of {like.passes} passes and alpha {like.alpha}; a linear "
                "program needs 1 layer of 1 pass and alpha = 1: take 'ipopt'"
            )
        if whole and engine != "highs":
            raise ValueError(f"engine {engine!r} with whole droplets; it knows relaxed ones only: take 'highs'")
        opti = ca.Opti("conic") if engine == "highs" else ca.Opti()
        given = _parameters(opti, like)
        droplets = [opti.variable(*like.part.shape) for _ in given.layers]
        for layer, U in zip(given.layers, droplets, strict=True):
            opti.subject_to(opti.bounded(0, ca.vec(U), ca.vec(layer.limit)))
            if whole:
                opti.set_domain(U, "integer")
        surfaces, H = [], given.height
        for layer, jetted in given.steps(droplets):
            after = opti.variable(*like.part.shape)
            opti.subject_to(ca.vec(after) == ca.vec(jet(H, layer, jetted)))
            surfaces.append(after)
            H = after

        cost = given.cost(
            H, lambda x: _positive_part(opti, x), lambda cells: 0 if like.alpha == 1.0 else _deviation(opti, cells)
        )
        opti.minimize(cost)
        opti.solver(engine, {"print_time": False, "error_on_fail": False}, _solver_options(engine, seconds_max))
        self._opti, self._given, self._droplets, self._surfaces, self._cost = opti, given, droplets, surfaces, cost
        self._whole, self._shape = whole, shape_of(like)

    def solve(self, problem: HorizonProblem, start: FloatMap | None = None) -> RelaxedPlan:
        """Solve for the values of a problem; start: droplets (layers, nx, ny) to begin at (None: half of each limit).

        Raises ValueError for a problem of another shape than the program was built for.
        """
        check_shape(problem, self._shape, "HorizonProgram")
        numbers = numbers_of(problem)
        for symbol, value in zip(self._given.values(), numbers.values(), strict=True):
            self._opti.set_value(symbol, value)
        begin = [layer.limit / 2 for layer in numbers.layers] if start is None else list(start)
        self._begin(numbers, begin)
        try:
            solution = self._opti.solve_limited()
        except RuntimeError as error:  # CasADi's word for a solver that gave up without a point to show
            value = exact_cost(numbers, begin) * M_PER_UM
            return RelaxedPlan(np.stack(begin), value, nan, False, str(error))
        stats = solution.stats()
        limits = np.stack([layer.limit for layer in numbers.layers])
        found = np.stack([np.reshape(solution.value(U), problem.part.shape) for U in self._droplets])
        droplets = np.asarray(np.clip(found, 0.0, limits), np.float64)
        value = exact_cost(numbers, list(droplets)) * M_PER_UM
        bound = self._bound(problem, float(solution.value(self._cost)), stats)
        return RelaxedPlan(droplets, value, bound, bool(stats["success"]), str(stats["return_status"]))

    def _begin(self, numbers: HorizonStatement, droplets: list[Any]) -> None:
        """Sets the droplets to begin at, and the surfaces that follow from them."""
        for symbol, value in zip(self._droplets, droplets, strict=True):
            self._opti.set_initial(symbol, value)
        H: Any = ca.DM(numbers.height)
        for surface, (layer, jetted) in zip(self._surfaces, numbers.steps(droplets), strict=True):
            H = jet(H, layer, jetted)
            self._opti.set_initial(surface, H)

    def _bound(self, problem: HorizonProblem, cost: float, stats: dict[str, Any]) -> float:
        """No plan has a lower objective [m]; nan if that is not known."""
        one_kind = not (problem.choices & (problem.choices - 1)).any()
        if problem.layers != 1 or problem.passes != 1 or not one_kind:
            return nan
        if self._whole:
            return max(0.0, float(stats["mip_dual_bound"]) - TOLERANCE) * M_PER_UM
        return max(0.0, cost - TOLERANCE) * M_PER_UM if stats["success"] else nan


def _positive_part(opti: Any, x: Symbolic) -> Symbolic:
    """The least that is neither below 0 nor below x; the objective presses on it."""
    least = opti.variable(*x.shape)
    opti.subject_to(ca.vec(least) >= 0)
    opti.subject_to(ca.vec(least) >= ca.vec(x))
    return least


def _deviation(opti: Any, cells: Symbolic) -> Symbolic:
    """Standard deviation of a column, with a mean that is a variable of its own.

    Written inside the objective they would make its Hessian dense. The best free mean is the mean, and the smallest
    deviation allowed is the deviation.
    """
    mean, least = opti.variable(), opti.variable()
    opti.subject_to(least >= 0)
    opti.subject_to(ca.sumsqr(cells - mean) / cells.numel() <= least**2 + SMOOTHING)
    opti.set_initial(least, 1.0)
    return least


def _parameters(opti: Any, like: HorizonProblem) -> HorizonStatement:
    """The statement with a parameter for every value of a problem of that shape."""

    def grid() -> Symbolic:
        return opti.parameter(*like.part.shape)

    # A solver of linear programs must not meet a product of parameters; of alpha = 1 it need not know.
    alpha: Symbolic = 1.0 if like.alpha == 1.0 else opti.parameter()
    layers = tuple(
        LayerSymbols(grid(), grid(), grid(), grid(), tuple(grid() for _ in range(like.passes)))
        for _ in range(like.layers)
    )
    ceiling = None if like.ceiling is None else grid()
    return HorizonStatement(
        like.part, grid(), grid(), ceiling, grid(), alpha, opti.parameter(), opti.parameter(), layers
    )


def shape_of(problem: HorizonProblem) -> tuple[Any, ...]:
    """Structure that a program is built for; everything else is a value."""
    part: BoolMap = problem.part
    return (part.shape, part.tobytes(), problem.layers, problem.passes, problem.ceiling is None, problem.alpha == 1.0)


def check_shape(problem: HorizonProblem, shape: tuple[Any, ...], program: str) -> None:
    """Raises ValueError for a problem of another shape than a program was built for."""
    if shape_of(problem) != shape:
        raise ValueError(
            "the problem differs from that which the program was built for in its grid, part, layers, passes, ceiling, "
            f"or in whether alpha is 1; build another {program}"
        )


def _solver_options(engine: Engine, seconds_max: float) -> dict[str, Any]:
    if engine == "ipopt":
        return {"print_level": 0, "sb": "yes", "tol": 1e-9, "max_iter": 300, "max_wall_time": min(seconds_max, 1e20)}
    return {"output_flag": False, "time_limit": seconds_max}
