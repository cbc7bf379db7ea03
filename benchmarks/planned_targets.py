"""Single layer problems: objective and time of the controller against exact solutions and targets."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import nan
from time import process_time

import numpy as np
from rich.progress import track
from rich.table import Table

from benchmarks.exhaustive import best_plan
from benchmarks.instances import nearly_flat, recoverable, rough
from benchmarks.planner import planned
from benchmarks.target_table import Figure, table
from inkloop.units import MEGA, UM_PER_M
from inkloop_controller.core import bindings
from inkloop_controller.model.starts import full_layers
from inkloop_controller.problem.horizon_problem import HorizonProblem
from inkloop_controller.program.program import HorizonProgram
from support.core_search import search

FOUND_UM = 1e-9
HIGHS_S = 20.0  # limit for each problem
PAPERS_BATCH = 20  # flips tried together (assumed, as in StochasticGreedy)
PIECE = 256  # cells a side of a surface of the same kind, on which annealing judges what is done on large grids
ANNEALING = 400  # sweeps: 100 are 0.03 % worse on rough surfaces, 1 % on nearly flat ones


def measure() -> Table:
    """Times are of the processor, on one thread, so that other programs count little."""
    cases: dict[str, Callable[[], list[Figure]]] = {
        "recover N = 1, 50 rough 20 x 20": lambda: _recovery(20, 1, range(50), 8e-6, 0.010, nan),
        "recover N = 1, a rough 500 x 500": lambda: _recovery(500, 1, range(1), 8e-6, nan, 1.0),
        "recover N = 2, 10 of 20 x 20, H 0 to 5 um": lambda: _recovery(20, 2, range(10), 5e-6, 2.0, 1.0),
        "rough 3 x 4, N = 2, alpha 1": lambda: _exhaustive(1.0),
        "rough 3 x 4, N = 2, alpha 0.5": lambda: _exhaustive(0.5),
        "rough 20 x 20, N = 1": lambda: _highs([rough((20, 20), seed=seed) for seed in range(3)]),
        "nearly flat 20 x 20, N = 1": lambda: _highs([nearly_flat(20, 1, seed) for seed in range(2)]),
        "nearly flat 100 x 100, N = 2": lambda: _nearly_flat(100, 2, range(5), (0.42, 0.3), (0.40, 0.3)),
        "nearly flat 100 x 100, N = 3": lambda: _nearly_flat(100, 3, range(5), (0.30, 1.0), (0.27, 1.0)),
        "nearly flat 500 x 500, N = 2": lambda: _nearly_flat(500, 2, range(1), (0.34, 8.0), (0.34, 3.0)),
        "nearly flat 500 x 500, N = 3": lambda: _nearly_flat(500, 3, range(1), (0.32, 8.0), (0.30, 3.0)),
        "rough 2048 x 2048, N = 1": lambda: _large(lambda side: rough((side, side))),
        "nearly flat 2048 x 2048, N = 1": lambda: _large(lambda side: nearly_flat(side, 1)),
    }
    rows = {name: figures() for name, figures in track(cases.items(), "layer problems", transient=True)}
    return table("single layer problems, alpha 1 unless stated", rows)


def _recovery(side: int, layers: int, seeds: range, rise: float, must_s: float, aim_s: float) -> list[Figure]:
    """How many targets that a plan has made are found again, by the controller and by the search from full layers."""
    problems = [recoverable(side, layers, seed, rise) for seed in seeds]
    ours = [_timed(problem) for problem in problems]
    searched = [_searched(problem) for problem in problems]
    papers = [_papers(problem) for problem in problems] if layers == 1 else []

    def found(runs: Sequence[tuple[float, float]]) -> list[float]:
        return [float(sum(value < FOUND_UM for value, _ in runs))] if runs else []

    return [
        Figure("recovered", found(ours), 0.0, 0.0, len(seeds), found(papers)),
        Figure("time each, s", _times(ours), must_s, aim_s, papers=_times(papers)),
        Figure("by the search alone: recovered", found(searched)),
        Figure("by the search alone: time each, s", _times(searched)),
    ]


def _exhaustive(alpha: float) -> list[Figure]:
    """Objective above that of the best of all plans."""
    problems = [rough((3, 4), 2, seed, alpha) for seed in range(3)]
    above = [
        _timed(problem)[0] - bindings.objective(problem, best_plan(problem)).value * UM_PER_M for problem in problems
    ]
    return [Figure("above the best of all plans, um", above, FOUND_UM, FOUND_UM)]


def _highs(problems: Sequence[HorizonProblem]) -> list[Figure]:
    """Objective above that of HiGHS's plan, and above its bound."""
    ours, papers = [_timed(problem) for problem in problems], [_papers(problem) for problem in problems]
    plans, bounds = [], []
    for problem in problems:
        found = HorizonProgram(problem, "highs", whole=True, seconds_max=HIGHS_S).solve(problem)
        plans.append(bindings.objective(problem, np.round(found.droplets).astype(np.int32)).value * UM_PER_M)
        bounds.append(found.bound * UM_PER_M)
    return [
        Figure(
            f"above HiGHS's plan of {HIGHS_S:.0f} s, %", _above(ours, plans), 0.5, 0.2, papers=_above(papers, plans)
        ),
        Figure("above its bound, %", _above(ours, bounds), papers=_above(papers, bounds)),
        Figure("time, s", _times(ours), 0.050, papers=_times(papers)),
    ]


def _nearly_flat(
    side: int, layers: int, seeds: range, must: tuple[float, float], aim: tuple[float, float]
) -> list[Figure]:
    """Objective and time."""
    ours = [_timed(nearly_flat(side, layers, seed)) for seed in seeds]
    return [
        Figure("objective, um", [value for value, _ in ours], must[0], aim[0]),
        Figure("time, s", _times(ours), must[1], aim[1]),
    ]


def _large(surface: Callable[[int], HorizonProblem]) -> list[Figure]:
    """Time per cell of a large grid, and on a piece that annealing can do, by how much annealing is better."""
    problem, piece = surface(2048), surface(PIECE)
    ours, searched = _timed(problem), _searched(problem)
    annealed = search(piece, full_layers(piece), sweeps_max=50, annealing_sweeps=ANNEALING).objective.value * UM_PER_M
    cells = problem.height.size / MEGA
    return [
        Figure("objective, um", [ours[0]]),
        Figure("time per cell, us", [ours[1] / cells], 2.0, 1.0),
        Figure(f"above annealing, {PIECE} x {PIECE}, %", _above([_timed(piece)], [annealed]), 0.6),
        Figure("by the search alone: objective, um", [searched[0]]),
        Figure("by the search alone: time per cell, us", [searched[1] / cells]),
        Figure("by the search alone: above annealing, %", _above([_searched(piece)], [annealed])),
    ]


def _timed(problem: HorizonProblem) -> tuple[float, float]:
    """Objective [um] of our controller's plan, and the processor time it took [s]."""
    begin = process_time()
    plan = planned(problem)
    return plan.objective.value * UM_PER_M, process_time() - begin


def _searched(problem: HorizonProblem) -> tuple[float, float]:
    """The same of the search core alone, from full layers."""
    begin = process_time()
    found = search(problem, full_layers(problem), sweeps_max=50)
    return found.objective.value * UM_PER_M, process_time() - begin


def _papers(problem: HorizonProblem) -> tuple[float, float]:
    """The same of the paper's search, from full layers."""
    begin = process_time()
    found = bindings.paper_search(problem, full_layers(problem), PAPERS_BATCH, 100_000, 0)
    return found.objective.value * UM_PER_M, process_time() - begin


def _times(runs: Sequence[tuple[float, float]]) -> list[float]:
    return [time_s for _, time_s in runs]


def _above(runs: Sequence[tuple[float, float]], references: Sequence[float]) -> list[float]:
    return [(value / reference - 1.0) * 100.0 for (value, _), reference in zip(runs, references, strict=True)]
