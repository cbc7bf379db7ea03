"""The paper's recoverability test: a target made by a random pattern must be found again exactly."""

from __future__ import annotations

from time import perf_counter

import numpy as np
from rich.table import Table

from benchmarks.naive_search import naive_search
from benchmarks.timing import scaled
from inkloop.component import Ink
from inkloop_controller import core
from inkloop_controller.core import HorizonProblem, IntMap, IntPlan
from reference.lu_numpy import one_pass

CASES = 50
SIDE = 20
FOUND_M = 1e-15  # 1e-9 um


def measure() -> Table:
    """Exact recoveries and time per case: our search, the paper's in C, and the paper's with whole evaluations."""
    searches = {
        "inkloop search": lambda problem, ones, case: core.search(problem, ones, sweeps_max=50).plan,
        "paper's search, in C": lambda problem, ones, case: core.paper_search(problem, ones, 20, 100_000, case).plan,
        "paper's search, NumPy, whole layers": _naive,
    }
    table = Table(title=f"recoverability: {CASES} random cases of {SIDE} x {SIDE}, one layer, alpha 1")
    for heading in ("search", "recovered", "time per case", "ratio"):
        table.add_column(heading, justify="right")
    fastest = None
    for name, search in searches.items():
        recovered, times = 0, []
        for case in range(CASES):
            problem, ones = _case(case)
            begin = perf_counter()
            plan = search(problem, ones, case)
            times.append(perf_counter() - begin)
            recovered += core.objective(problem, plan).value < FOUND_M
        time = float(np.median(times))
        fastest = fastest or time
        table.add_row(name, f"{recovered} of {CASES}", scaled(time), f"{time / fastest:.0f}")
    return table


def _case(number: int) -> tuple[HorizonProblem, IntPlan]:
    """A rough surface, and as target what a random pattern makes of it; the start is a full layer."""
    rng = np.random.default_rng(number)
    height = rng.uniform(0.0, 8e-6, (SIDE, SIDE))
    hidden = rng.integers(0, 2, (SIDE, SIDE), dtype=np.int32)
    everywhere = np.ones((SIDE, SIDE), dtype=np.bool_)
    target = core.layer(height, hidden, (Ink(),))
    problem = HorizonProblem(height, target, everywhere, np.ones((1, SIDE, SIDE), np.uint16), (Ink(),), 1.0)
    return problem, np.ones((1, SIDE, SIDE), dtype=np.int32)


def _naive(problem: HorizonProblem, ones: IntPlan, case: int) -> IntPlan:
    def objective(pattern: IntMap) -> float:
        return float(np.abs(problem.target - one_pass(problem.height, pattern)[0]).mean())

    return naive_search(objective, ones[0], 20, np.random.default_rng(case))[None]
