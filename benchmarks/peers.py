"""The same layer problems in one run: inkloop's controller and other solvers."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable
from dataclasses import dataclass
from math import inf, isnan, nan
from time import perf_counter

import casadi as ca
import numpy as np
from rich.console import Group
from rich.progress import track
from rich.table import Table
from rich.text import Text

from benchmarks.instances import nearly_flat, rough
from benchmarks.naive_search import naive_search
from benchmarks.planner import planned
from benchmarks.timing import scaled
from inkloop.units import M_PER_UM, UM_PER_M
from inkloop_controller.core import bindings
from inkloop_controller.model.starts import full_layers
from inkloop_controller.model.symbolic_layer import symbolic_layer
from inkloop_controller.problem.horizon_problem import HorizonProblem, IntPlan
from inkloop_controller.program.program import HorizonProgram
from support.core_search import search
from support.numpy.lu_numpy import one_pass

LIMIT_S = 20.0  # for each problem
CASES = (
    *((f"rough {side} x {side}\nN = 1", rough((side, side))) for side in (4, 6, 8, 12, 20, 50, 100)),
    *(
        (f"nearly flat {side} x {side}\nN = {layers}", nearly_flat(side, layers))
        for layers in (1, 2)
        for side in (8, 20, 100)
    ),
)
PAPERS_BATCH = 20  # flips tried together (assumed, as in StochasticGreedy)
BONMIN_CELLS = 36  # it needs more than a minute for a grid as large (by trial)


@dataclass(frozen=True)
class Answer:
    """A plan (layers, nx, ny), None: none within the limit; and what no plan can be below [m], NaN: not known."""

    plan: IntPlan | None
    bound: float = nan


Solver = Callable[[HorizonProblem], Answer | None]
"""None: it is not made for the problem."""


NOTE = (
    'gap: the best plan is at most this share of its objective above the optimum, by the bound of HiGHS; "none": no '
    "plan within the limit; IPOPT, HiGHS and Bonmin are those of CasADi's wheel"
)


def measure() -> Group:
    """Distance of each plan from the best one of all, and wall time."""
    solvers: dict[str, Solver] = {
        "inkloop": lambda problem: Answer(planned(problem).plan),
        "search alone": lambda problem: Answer(search(problem, full_layers(problem), sweeps_max=50).plan),
        "paper's, in C": _paper,
        "paper's, NumPy": _naive,
        "IPOPT, rounded": _ipopt,
        "HiGHS": _highs,
        "Bonmin": _bonmin,
    }
    title = f"above the best plan found, and wall time; alpha 1, every solver stops after {LIMIT_S:.0f} s"
    table = Table(title=title, show_lines=True)
    for heading in ("problem", "best, um", "gap", *solvers):
        table.add_column(heading, justify="right")
    for name, problem in track(CASES, "peers", transient=True):
        values: dict[str, float] = {}
        times: dict[str, str] = {}
        bound = nan
        for solver, solve in solvers.items():
            begin = perf_counter()
            answer = solve(problem)
            if answer is not None:
                times[solver] = scaled(perf_counter() - begin)
                values[solver] = inf if answer.plan is None else bindings.objective(problem, answer.plan).value
                bound = bound if isnan(answer.bound) else answer.bound
        best = min(values.values())
        above = {each: f"+{value / best - 1.0:.2%}" if value < inf else "none" for each, value in values.items()}
        cells = [f"{above[each]}\n{times[each]}" if each in above else "-" for each in solvers]
        table.add_row(name, f"{best * UM_PER_M:.4f}", "-" if isnan(bound) else f"{1.0 - bound / best:.2%}", *cells)
    return Group(table, Text(NOTE))


def _paper(problem: HorizonProblem) -> Answer | None:
    if problem.layers > 1:
        return None
    return Answer(bindings.paper_search(problem, full_layers(problem), PAPERS_BATCH, 100_000, 0).plan)


def _naive(problem: HorizonProblem) -> Answer:
    def objective(plan: IntPlan) -> float:
        surface = problem.height
        for pattern in plan:
            surface, _ = one_pass(surface, pattern)
        return float(np.abs(problem.target - surface).mean())

    generator = np.random.default_rng(0)
    return Answer(naive_search(objective, full_layers(problem), PAPERS_BATCH, generator, seconds_max=LIMIT_S))


def _ipopt(problem: HorizonProblem) -> Answer:
    """The droplets that it ends with, solved or not."""
    found = HorizonProgram(problem, "ipopt", seconds_max=LIMIT_S).solve(problem)
    return Answer(np.round(found.droplets).astype(np.int32))


def _highs(problem: HorizonProblem) -> Answer | None:
    if problem.layers > 1:
        return None
    found = HorizonProgram(problem, "highs", whole=True, seconds_max=LIMIT_S).solve(problem)
    return Answer(np.round(found.droplets).astype(np.int32), found.bound)


def _bonmin(problem: HorizonProblem) -> Answer | None:
    """Branch and bound over IPOPT by way of CasADi, as do-mpc does it for whole inputs.

    In a process of its own, to be killed at the limit and silenced: CasADi hands no option on to Bonmin.
    """
    if problem.layers > 1 or problem.part.size > BONMIN_CELLS or not ca.has_nlpsol("bonmin"):
        return None
    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=lambda: sender.send(_bonmin_plan(problem)))
    process.start()
    plan = receiver.recv() if receiver.poll(LIMIT_S) else None
    process.kill()
    process.join()
    return Answer(plan)


def _bonmin_plan(problem: HorizonProblem) -> IntPlan:
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    opti, ink, shape = ca.Opti(), problem.kinds[0], problem.part.shape
    U, above, below = (opti.variable(*shape) for _ in range(3))
    shares = [np.full(shape, height / M_PER_UM) for height in (ink.h1, ink.h2, ink.h3)]
    H = symbolic_layer(ca.MX(problem.height / M_PER_UM), U, *shares)
    opti.set_domain(U, "integer")
    opti.subject_to(opti.bounded(0, ca.vec(U), 1))
    for excess in (above, below):
        opti.subject_to(ca.vec(excess) >= 0)
    opti.subject_to(ca.vec(H - problem.target / M_PER_UM - above + below) == 0)
    opti.minimize(ca.sum1(ca.vec(above + below)) / problem.part.size)
    opti.solver("bonmin", {"print_time": False})
    return np.round(np.reshape(opti.solve().value(U), (1, *shape))).astype(np.int32)
