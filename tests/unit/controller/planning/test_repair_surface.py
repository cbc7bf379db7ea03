"""Repairs take over the surface that the first plans were evaluated on: nothing of those plans is left on it."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest

from inkloop.component import Ink
from inkloop_controller.core import bindings
from inkloop_controller.problem.criterion import Work
from inkloop_controller.problem.horizon_problem import HorizonProblem, full_layers, no_droplets
from support.core_search import search
from support.numpy.plan_starts_numpy import shifted
from support.problem_plans import best_plan

SHAPE, SWEEPS = (17, 15), 12
SEED = ((2**32 - 1) << 32) + 7  # of the job, and of the layer
ORDER = ((0, 3, 1, 2), (2, 1, 3, 0))


def problem(passes: int, alpha: float) -> HorizonProblem:
    height = np.random.default_rng(5).uniform(0.0, 8e-6, SHAPE)
    everywhere, target = np.ones(SHAPE, np.bool_), np.full(SHAPE, height.mean() + 13.5e-6)
    return HorizonProblem(
        height,
        target,
        everywhere,
        np.ones((2, *SHAPE), np.uint16),
        (Ink(),),
        alpha,
        ceiling=target + 8e-6,
        ceiling_cost=10.0,
        droplet_std=0.1,
        colours=ORDER if passes == 4 else (),
    )


@pytest.mark.parametrize("annealing", [0, 2])
@pytest.mark.parametrize(("passes", "alpha"), [(1, 0.8), (4, 0.8), (1, 1.0)])
def test_repaired_plan_is_the_best_that_searches_on_new_surfaces_find(
    passes: int, alpha: float, annealing: int
) -> None:
    """The last plan is evaluated last, and worse than others: the first repair finds its surface. Where plans are
    annealed every start is repaired, each on the surface that the repair before left, and the best one once more."""
    of, last = problem(passes, alpha), (np.random.default_rng(6).random((1, *SHAPE)) < 0.1).astype(np.int32)
    starts = [no_droplets(of), full_layers(of), shifted(last, of)]
    starts.sort(key=lambda plan: bindings.objective(of, plan).value)
    tasks = [(plan, 0) for plan in starts] + [(starts[0], annealing)] if annealing else [(starts[0], 0)]
    searches = [search(of, plan, sweeps_max=SWEEPS, annealing_sweeps=sweeps, seed=SEED) for plan, sweeps in tasks]
    best = min(searches, key=lambda search: search.objective.value)
    assert not np.array_equal(starts[0], shifted(last, of))

    work = Work(sweeps=SWEEPS, annealing_sweeps=annealing)
    found = best_plan(of, work, relaxed=None, last=last, layer_worth=0.0, seed=SEED, seconds_max=inf)
    np.testing.assert_array_equal(found.plan, best.plan)
    assert found.objective == best.objective == bindings.objective(of, found.plan)
    assert found.sweeps == sum(search.sweeps for search in searches)
