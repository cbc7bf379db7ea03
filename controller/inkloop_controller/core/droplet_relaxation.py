"""Droplets relaxed to any size, by gradients, and rounded again by error diffusion: a start for the search."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from math import inf

import numpy as np

from inkloop.component import FloatMap
from inkloop_controller.core.bindings import answered, checked, pointer, problem_struct
from inkloop_controller.core.library import library
from inkloop_controller.core.structs import RelaxationOptionsStruct, RelaxationReportStruct
from inkloop_controller.problem.horizon_problem import HorizonProblem, IntPlan

ITERATIONS = 30  # by trial: within 0.01 um of the optimum on rough and on nearly flat surfaces up to 100x100


@dataclass(frozen=True, eq=False)
class RelaxedDroplets:
    """Droplets (layers, nx, ny) counted in droplets of the first kind allowed on a cell, and their smoothed value [m].

    Of a horizon of several steps they are near a local optimum: the value is no bound on anything.
    """

    droplets: FloatMap
    value: float
    iterations: int


def relax(
    problem: HorizonProblem,
    start: FloatMap | None = None,
    *,
    iterations_max: int = ITERATIONS,
    seconds_max: float = inf,
    threads: int = 1,
) -> RelaxedDroplets:
    """Droplets near an optimum of the relaxed problem, by accelerated projected gradients.

    start: droplets (layers, nx, ny) to begin at, which the answer is not worse than (None: half a droplet each);
    iterations_max: work budget; seconds_max: guard by the clock; threads: does not change the answer. Raises ValueError
    for invalid values.
    """
    if iterations_max < 0 or not seconds_max >= 0.0:
        raise ValueError(f"iterations_max is {iterations_max} and seconds_max {seconds_max}; needs neither below 0")
    given = np.full(problem.choices.shape, 0.5) if start is None else start
    droplets = np.array(checked("start", given, "f8", problem.choices.shape))
    report = RelaxationReportStruct()
    options = RelaxationOptionsStruct(iterations_max, seconds_max, threads)
    answered(library().inkloop_relax(problem_struct(problem), options, pointer(droplets), report))
    return RelaxedDroplets(droplets, report.value, report.iterations)


def relaxed_gradient(problem: HorizonProblem, droplets: FloatMap, smoothing: float) -> tuple[float, FloatMap]:
    """Smoothed objective [m] of droplets (layers, nx, ny), and its gradient (layers, nx, ny) [m per droplet].

    smoothing s [m]: max(x, 0) becomes (x + sqrt(x^2 + s^2)) / 2, the standard deviation sqrt(variance + s^2).
    """
    given = checked("droplets", droplets, "f8", problem.choices.shape)
    value, gradient = ctypes.c_double(), np.empty(given.shape)
    struct = problem_struct(problem)
    answered(library().inkloop_relaxed_gradient(struct, pointer(given), smoothing, value, pointer(gradient)))
    return value.value, gradient


def diffuse(problem: HorizonProblem, droplets: FloatMap) -> IntPlan:
    """A plan with nearly the same number of droplets around every cell, the last layers filled first.

    droplets: (layers, nx, ny), of any size. A full layer flows into the gaps that a partial one left below.
    """
    given = checked("droplets", droplets, "f8", problem.choices.shape)
    plan = np.empty(given.shape, np.int32)
    answered(library().inkloop_diffuse(problem_struct(problem), pointer(given), pointer(plan)))
    return plan
