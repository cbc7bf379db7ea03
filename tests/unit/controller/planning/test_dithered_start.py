"""The start of a single layer: droplets diffused or dithered, whichever are better; dithered only without a plan."""

from __future__ import annotations

from dataclasses import replace
from math import inf
from typing import Any

import numpy as np
import pytest

from inkloop_controller.core import bindings
from inkloop_controller.core.bindings import diffuse
from inkloop_controller.planning.layer_plan import LeftOut
from inkloop_controller.problem.criterion import Work
from inkloop_controller.problem.horizon_problem import HorizonProblem, IntPlan, even_droplets
from support.core_search import relax, search
from support.layer_problems import INKS, ORDERS, nearly_flat, rough
from support.numpy.relaxation_numpy import dithered
from support.problem_plans import best_plan

SHAPE = (42, 39)
WORK = Work(sweeps=30, annealing_sweeps=0)


def planned(problem: HorizonProblem, last: IntPlan | None = None, **options: Any) -> IntPlan:
    nothing = np.zeros((0, *problem.part.shape), np.int32)
    given = {"seconds_max": inf, "layer_worth": 0.0, "seed": 1, "last": nothing if last is None else last, **options}
    return best_plan(problem, WORK, **given).plan


def repaired(problem: HorizonProblem, start: IntPlan) -> IntPlan:
    return search(problem, start, sweeps_max=WORK.sweeps).plan


def two_inks(shape: tuple[int, int]) -> HorizonProblem:
    choices = np.where(np.arange(shape[1]) < 20, 1, 2) * np.ones((1, *shape), np.int64)
    choices[0, 3, :] = 0
    return nearly_flat(shape, kinds=INKS, choices=choices.astype(np.uint16))


@pytest.mark.parametrize("alpha", [1.0, 0.8])
def test_dithered_droplets_are_repaired_where_they_are_better(alpha: float) -> None:
    for problem in (nearly_flat(SHAPE, alpha=alpha), replace(two_inks(SHAPE), alpha=alpha)):
        even = even_droplets(problem)
        diffusion, dither = repaired(problem, diffuse(problem, even)), repaired(problem, dithered(problem, even))
        np.testing.assert_array_equal(planned(problem), dither)
        assert bindings.objective(problem, dither).value < 0.99 * bindings.objective(problem, diffusion).value


def test_diffused_droplets_are_repaired_where_they_are_better() -> None:
    problem = rough(SHAPE, seed=1)
    np.testing.assert_array_equal(planned(problem), repaired(problem, diffuse(problem, even_droplets(problem))))


def test_droplets_that_are_given_are_dithered_too() -> None:
    problem = nearly_flat(SHAPE)
    given = np.clip(even_droplets(problem) + 0.05, 0.0, 1.0)
    np.testing.assert_array_equal(planned(problem, relaxed=given), repaired(problem, dithered(problem, given)))


def test_last_plan_leaves_diffused_droplets_and_an_empty_one_does_not() -> None:
    problem = nearly_flat(SHAPE)
    empty = np.zeros((1, *SHAPE), np.int32)
    np.testing.assert_array_equal(planned(problem, empty), planned(problem))
    last = empty.copy()
    last[0, 0, 0] = 1
    np.testing.assert_array_equal(planned(problem, last), repaired(problem, diffuse(problem, even_droplets(problem))))


def test_relaxed_droplets_of_four_passes_are_dithered() -> None:
    problem = nearly_flat((100, 100), colours=ORDERS[:1])
    relaxed = relax(problem, even_droplets(problem), iterations_max=WORK.iterations).droplets
    np.testing.assert_array_equal(planned(problem), repaired(problem, dithered(problem, relaxed)))


def test_several_layers_are_never_dithered() -> None:
    """Even if nothing may fall in the second one."""
    choices = np.ones((2, 100, 100), np.uint16)
    choices[1] = 0
    problem = nearly_flat((100, 100), 2, choices=choices)
    problem = replace(problem, target=problem.height.mean() + 0.6 * 7.6e-6 * np.ones((100, 100)))
    relaxed = relax(problem, even_droplets(problem), iterations_max=WORK.iterations).droplets
    np.testing.assert_array_equal(planned(problem), repaired(problem, diffuse(problem, relaxed)))


def test_time_limit_that_is_wide_enough_changes_nothing() -> None:
    problem = nearly_flat(SHAPE)
    found = best_plan(problem, WORK, last=np.zeros((0, *SHAPE), np.int32), layer_worth=0.0, seed=1, seconds_max=1e6)
    np.testing.assert_array_equal(found.plan, planned(problem))
    assert found.left_out == LeftOut.NOTHING
