"""Stages of a plan alone, for tests and benchmarks: the relaxation by gradients, and the search that repairs a plan."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from ctypes import c_double, c_int32, c_int64, c_void_p
from dataclasses import dataclass
from enum import Enum, IntFlag
from math import inf
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap
from inkloop_controller.core.bindings import Calls, answered, droplets_of, objective_of
from inkloop_controller.core.library import ReportStruct, SearchOptionsStruct, library, problem_struct, structure
from inkloop_controller.problem.arrays import checked
from inkloop_controller.problem.horizon_problem import HorizonProblem, IntPlan, Objective, SearchProgress

ITERATIONS = 30  # by trial: within 0.01 um of the optimum on rough and on nearly flat surfaces up to 100x100

RelaxationOptions = structure(
    "RelaxationOptions", (c_int64, "iterations_max"), (c_double, "seconds_max"), (c_int32, "threads")
)
RelaxationReport = structure("RelaxationReport", (c_double, "value"), (c_int64, "iterations"))


class Moves(IntFlag):
    """The moves of a search: what one step may change."""

    FLIPS = 1  # a cell's droplet: put, taken, or of another kind
    SWAPS = 2  # the place of a droplet: a neighbouring cell of the same layer
    SHIFTS = 4  # the layer of a droplet on its cell
    ALL = 7


class SearchStatus(Enum):
    """Why a search ended."""

    DONE = 0  # no single change improves the plan
    BUDGET = 1  # all sweeps done
    TIME = 2  # the guard by the clock
    STOPPED = 3  # by after_sweep


@dataclass(frozen=True, eq=False)
class SearchResult:
    """A plan (layers, nx, ny) with its objective, evaluated from scratch; `incremental`: its value by running sums [m].

    interrupted: it was stopped by KeyboardInterrupt.
    """

    plan: IntPlan
    objective: Objective
    incremental: float
    status: SearchStatus
    sweeps: int
    evaluations: int
    flips: int
    swaps: int
    shifts: int
    interrupted: bool = False


class RelaxedDroplets(NamedTuple):
    """Droplets (layers, nx, ny) counted in droplets of the first kind allowed on a cell, and their smoothed value [m].

    Of a horizon of several steps they are near a local optimum: the value is no bound on anything.
    """

    droplets: FloatMap
    value: float
    iterations: int


def search(
    problem: HorizonProblem,
    start: IntPlan,
    *,
    sweeps_max: int,
    moves: Moves = Moves.ALL,
    annealing_sweeps: int = 0,
    seed: int = 0,
    seconds_max: float = inf,
    threads: int = 1,
    after_sweep: Callable[[SearchProgress], bool] | None = None,
) -> SearchResult:
    """Improve a plan by `moves` until none helps, or for `sweeps_max` sweeps; the result is never worse than `start`.

    annealing_sweeps: sweeps of simulated annealing before, drawn from `seed`; after_sweep: True stops the search, as
    does KeyboardInterrupt, which the result shows; any other exception is raised again.
    """
    plan, report, asked = droplets_of(problem, start), ReportStruct(), Calls(after_sweep)
    budget = (annealing_sweeps, sweeps_max, seed, seconds_max, threads)
    options = SearchOptionsStruct(int(moves), *budget, asked.after_sweep, None)
    code = _called("search", problem, options, plan, report)
    counts = (report.sweeps, report.evaluations, report.flips, report.swaps, report.shifts)
    value, status = objective_of(report.objective), SearchStatus(code)
    return SearchResult(plan, value, report.incremental, status, *counts, asked.was_interrupted())


def relax(
    problem: HorizonProblem,
    start: FloatMap | None = None,
    *,
    iterations_max: int = ITERATIONS,
    seconds_max: float = inf,
    threads: int = 1,
) -> RelaxedDroplets:
    """Droplets of any size near an optimum of the relaxed problem, by accelerated projected gradients.

    start: droplets (layers, nx, ny) to begin at, which the answer is not worse than (None: half a droplet each).
    """
    given = np.full(problem.choices.shape, 0.5) if start is None else start
    droplets, report = np.array(checked("start", given, "f8", problem.choices.shape)), RelaxationReport()
    _called("relax", problem, RelaxationOptions(iterations_max, seconds_max, threads), droplets, report)
    return RelaxedDroplets(droplets, report.value, report.iterations)


def _called(name: str, problem: HorizonProblem, options: Any, changed: NDArray[Any], report: Any) -> int:
    """An entry point of inkloop_core.h that takes a problem and options, and changes an array."""
    function = ctypes.CFUNCTYPE(c_int32, *[c_void_p] * 4)((f"inkloop_{name}", library()))
    struct, address = problem_struct(problem), ctypes.addressof
    return answered(function(address(struct), address(options), changed.ctypes.data, address(report)))
