"""Threads share the rows of relaxation and evaluation, and the tiles of the search: the plan is the same."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest

from inkloop.component import Ink
from inkloop_controller.planning.horizon_planner import FoundPlan
from inkloop_controller.problem.criterion import Work
from inkloop_controller.problem.horizon_problem import HorizonProblem
from support.problem_plans import best_plan

SHAPE = (190, 131)  # three shares of rows, of different lengths


def found(threads: int, passes: int) -> FoundPlan:
    height = np.random.default_rng(1).uniform(0.0, 8e-6, SHAPE)
    everywhere, target = np.ones(SHAPE, np.bool_), np.full(SHAPE, height.mean() + 7e-6)
    colours = ((0, 3, 1, 2), (2, 1, 3, 0)) if passes == 4 else ()
    choices = np.ones((2, *SHAPE), np.uint16)
    problem = HorizonProblem(
        height, target, everywhere, choices, (Ink(),), 0.8, ceiling=target + 1e-6, droplet_std=0.1, colours=colours
    )
    last = np.random.default_rng(2).integers(0, 2, choices.shape, dtype=np.int32)
    work = Work(sweeps=1, annealing_sweeps=0, iterations=2, threads=threads)
    return best_plan(problem, work, last=last, layer_worth=0.001, seed=1, seconds_max=inf)


@pytest.mark.parametrize("passes", [1, 4])
def test_any_number_of_threads_makes_the_same_plan(passes: int) -> None:
    one, *more = (found(threads, passes) for threads in (1, 2, 3))
    assert one.plan.any()
    for other in more:
        assert (other.objective, other.start, other.sweeps) == (one.objective, one.start, one.sweeps)
        np.testing.assert_array_equal(other.plan, one.plan)
