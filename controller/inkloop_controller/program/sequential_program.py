"""The relaxed layer problem over any horizon, as a sequence of linear programs."""

from __future__ import annotations

from math import inf, nan
from time import monotonic

import numpy as np

from inkloop.component import FloatMap
from inkloop.units import M_PER_UM
from inkloop_controller.problem.horizon_problem import HorizonProblem, even_droplets
from inkloop_controller.program.linear_step import LinearProgram, Point, as_cells
from inkloop_controller.program.program import RelaxedPlan, check_shape, shape_of
from inkloop_controller.program.statement import HorizonStatement, drop_limits, numbers_of

PROGRAMS_MAX = 40  # linear programs of one problem (by trial: most end after 5 to 25)
TANGENTS_MAX = 7  # of the square of each cell (by trial: 10 bring less than 0.1 % and take an eighth longer)
SPREAD_UM = (3.0, -3.0, 1.0, -1.0, 0.0)  # from a cell's place to its first tangents (assumed)
ENOUGH = 1e-4  # of the objective: a step that promises less ends the search (assumed)
LEAST_UM = 1e-3  # below that an objective is as good as zero: a 7,600th of a layer (assumed)
FIRST_RADIUS = 0.5  # droplets (assumed)
LEAST_RADIUS = 1e-4  # droplets (assumed)
TIME_LIMIT, FAILED = "time limit", "HiGHS has not solved a linear program"
ACCEPTED, TRUSTED, DOUBTED = 0.05, 0.75, 0.25  # shares of the promised gain (Nocedal, Wright 2006, algorithm 4.1)


class SequentialProgram:
    """Sequential linear programming with a trust region (Fletcher, Sainz de la Maza 1989), for any horizon and alpha.

    Each linear program is the problem with its layer map linearised around the present droplets, which may change by
    at most `radius`. The radius grows where the true objective falls as promised, and shrinks where it does not. Errors
    and ceiling are piecewise linear and stay exact, the standard deviation is held up by tangents (LinearProgram):
    where they were what promised too much, the same radius is tried with more of them. Of one layer in one pass the
    map is linear: there with alpha = 1 the first program is the problem. Over more steps the optimum is a local one.
    Built once for a grid, part, horizon and passes. seconds_max: what a problem may take.
    """

    def __init__(self, like: HorizonProblem, *, seconds_max: float = inf) -> None:
        self._shape, self._is_linear, self._seconds_max = shape_of(like), like.layers * like.passes == 1, seconds_max
        self._program = LinearProgram(like, tangents_max=TANGENTS_MAX, seconds_max=seconds_max)

    def solve(self, problem: HorizonProblem, start: FloatMap | None = None) -> RelaxedPlan:
        """The best droplets found; start: droplets (layers, nx, ny) to begin at (None: what lacks, in even shares).

        No linear program is begun that would pass the time limit if it took as long as the last one; the droplets are
        then the best so far, and `solved` is false. Raises ValueError for a problem of another shape than the program
        was built for.
        """
        check_shape(problem, self._shape, "SequentialProgram")
        numbers, limits = numbers_of(problem), drop_limits(problem)
        begin = np.clip(even_droplets(problem) if start is None else start, 0.0, limits)
        best, message = self._improved(
            numbers, self._program.point(numbers, [as_cells(U) for U in begin]), limits.max()
        )
        droplets = np.stack([np.reshape(U, problem.part.shape, order="F") for U in best.droplets])
        solved = message not in (TIME_LIMIT, FAILED)
        return RelaxedPlan(droplets, best.value * M_PER_UM, nan, solved, message)

    def _improved(self, numbers: HorizonStatement, best: Point, largest: float) -> tuple[Point, str]:
        """The best point found, and why the search has ended; largest: the widest radius [droplets]."""
        began = last = monotonic()
        radius = largest if self._is_linear else FIRST_RADIUS
        touching = [self._program.off_mean(best.surfaces[-1]) + spread for spread in SPREAD_UM]
        for _ in range(PROGRAMS_MAX):
            now = monotonic()
            if now - began + (now - last) > self._seconds_max:
                return best, TIME_LIMIT
            last = now
            step = self._program.step(numbers, best, radius, touching)
            if step is None:
                return best, FAILED
            promised = best.value - step.promised
            if promised <= ENOUGH * max(best.value, LEAST_UM) or radius < LEAST_RADIUS:
                return best, "optimum"
            trial = self._program.point(numbers, step.droplets)
            touching.append(self._program.off_mean(step.surface))
            share = (best.value - trial.value) / promised
            if share > ACCEPTED:
                is_bounded = _largest_change(best, trial) > 0.99 * radius
                best = trial
                touching.append(self._program.off_mean(best.surfaces[-1]))
                if share > TRUSTED and is_bounded:
                    radius = min(largest, 2.0 * radius)
                elif share < DOUBTED:
                    radius /= 2.0
            elif best.value - step.linear > promised / 2.0:  # the tangents have kept their promise, the map has not
                radius /= 3.0
        return best, f"{PROGRAMS_MAX} linear programs"


def _largest_change(before: Point, after: Point) -> float:
    return max(float(np.abs(U - V).max()) for U, V in zip(before.droplets, after.droplets, strict=True))
