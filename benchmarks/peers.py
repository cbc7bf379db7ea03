"""Whole droplets for the next layers, by the search core and by what others would take for them."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

import casadi as ca
import numpy as np
from rich.table import Table

from benchmarks.instances import nearly_flat
from benchmarks.naive_search import naive_search
from benchmarks.timing import scaled
from inkloop_controller import core
from inkloop_controller.droplet_relaxation import diffuse, relax
from inkloop_controller.horizon_problem import HorizonProblem, IntPlan
from inkloop_controller.horizon_program import HorizonProgram
from inkloop_controller.symbolic_layer import symbolic_layer
from reference.lu_numpy import one_pass

CASES = ((4, 1), (8, 1), (20, 1), (50, 1), (100, 1), (20, 2), (100, 2))
LIMIT_S = 20.0  # of a peer's solver, where it keeps one
REACH = {"naive stochastic greedy": 20, "IPOPT, rounded": 50, "HiGHS": 50, "Bonmin": 4}
"""Side times layers up to which a peer is run: beyond it takes minutes, whatever limit it is given."""
SEVERAL_LAYERS = ("inkloop", "IPOPT, rounded")
"""The others take one layer: over more the surface is not linear in the droplets."""
UM = 1e6
_BONMIN = {"print_level": 0, "time_limit": LIMIT_S, "bb_log_level": 0, "nlp_log_level": 0}

Solve = Callable[[HorizonProblem], IntPlan]


def measure() -> Table:
    """Objective, its distance from the best found by anybody, and time, all on the same problems in one run."""
    solvers: dict[str, Solve] = {
        "inkloop": _ours,
        "naive stochastic greedy": _naive,
        "IPOPT, rounded": _ipopt,
        "HiGHS": _highs,
        "Bonmin": _bonmin,
    }
    table = Table(title=f"whole droplets on nearly flat printed surfaces, alpha 1, solvers stop after {LIMIT_S:.0f} s")
    for heading in ("grid, layers", "solver", "objective [um]", "above the best", "time"):
        table.add_column(heading, justify="right")
    for side, layers in CASES:
        problem, found = nearly_flat(side, layers), {}
        for name, solve in solvers.items():
            if side * layers <= REACH.get(name, side * layers) and (layers == 1 or name in SEVERAL_LAYERS):
                begin = perf_counter()
                plan = solve(problem)
                found[name] = core.objective(problem, plan).value * UM, perf_counter() - begin
        best = min(value for value, _ in found.values())
        for name in solvers:
            if name in found:
                value, time = found[name]
                figures = f"{value:.4f}", f"{value / best - 1.0:.1%}", scaled(time)
            else:
                figures = "N/A", "N/A", "N/A"
            table.add_row(f"{side} x {side}, {layers}", name, *figures, end_section=name == "Bonmin")
    return table


def _ours(problem: HorizonProblem) -> IntPlan:
    start = diffuse(problem, relax(problem).droplets)
    return core.search(problem, start, sweeps_max=50).plan


def _naive(problem: HorizonProblem) -> IntPlan:
    def objective(pattern: IntPlan) -> float:
        return float(np.abs(problem.target - one_pass(problem.height, pattern)[0]).mean())

    ones = np.ones(problem.height.shape, np.int32)
    return naive_search(objective, ones, 20, np.random.default_rng(0))[None]


def _ipopt(problem: HorizonProblem) -> IntPlan:
    return np.round(HorizonProgram(problem, "ipopt").solve(problem).droplets).astype(np.int32)


def _highs(problem: HorizonProblem) -> IntPlan:
    program = HorizonProgram(problem, "highs", whole=True, seconds_max=LIMIT_S)
    return np.round(program.solve(problem).droplets).astype(np.int32)


def _bonmin(problem: HorizonProblem) -> IntPlan:
    """Branch and bound over IPOPT by way of CasADi, as do-mpc does it for whole inputs."""
    opti, ink = ca.Opti(), problem.kinds[0]
    shape = problem.height.shape
    U, above, below = (opti.variable(*shape) for _ in range(3))
    maps = [np.full(shape, height * UM) for height in (ink.h1, ink.h2, ink.h3)]
    H = symbolic_layer(ca.MX(problem.height * UM), U, *maps)
    opti.subject_to(opti.bounded(0, ca.vec(U), 1))
    for excess in (above, below):
        opti.subject_to(ca.vec(excess) >= 0)
    opti.subject_to(ca.vec(H - problem.target * UM - above + below) == 0)
    opti.set_domain(U, "integer")
    opti.minimize(ca.sum1(ca.vec(above + below)) / problem.height.size)
    opti.solver("bonmin", {"print_time": False}, _BONMIN)
    solution = opti.solve_limited()
    return np.round(np.asarray(solution.value(U)).reshape(shape)).astype(np.int32)[None]
