"""Far below the target full layers are proven best, and a search is left out: no plan is better where it is."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from math import inf
from typing import Any

import numpy as np
import pytest

from inkloop.component import Ink
from inkloop_controller.core import bindings
from inkloop_controller.planning.horizon_planner import FoundPlan
from inkloop_controller.planning.layer_plan import PlanStatus
from inkloop_controller.problem.criterion import Work
from inkloop_controller.problem.horizon_problem import HorizonProblem
from support.problem_plans import best_plan

INK = Ink()
TWO_SIZES = (Ink(INK.h1 / 2, INK.h2 / 2, INK.h3 / 2), INK)
WORK = Work(annealing_sweeps=0)
COLOURS = ((2, 0, 3, 1),)


def problem(rng: np.random.Generator) -> HorizonProblem:
    """Two layers of one size or one layer of two, on four or five cells; from far below the target to above it."""
    layers, kinds, shape = ((2, (INK,), (2, 2)), (1, TWO_SIZES, (1, 5)))[rng.integers(2)]
    height = rng.uniform(0.0, rng.choice([1e-6, 6e-6, 30e-6]), shape)
    part = rng.random(height.shape) < 0.8
    part[0, 0] = True
    return HorizonProblem(
        height=height,
        target=np.full(height.shape, rng.uniform(10e-6, 80e-6)),
        part=part,
        choices=np.where(rng.random((layers, *height.shape)) < 0.9, 2 ** len(kinds) - 1, 0).astype(np.uint16),
        kinds=kinds,
        alpha=rng.choice([0.05, 0.2, 0.5, 0.8, 1.0]),
        droplet_std=rng.choice([0.0, 0.1, 0.3]),
        colours=COLOURS * layers if rng.random() < 0.3 else (),
    )


def planned(of: HorizonProblem) -> FoundPlan:
    nothing = np.zeros(of.choices.shape, np.int32)
    return best_plan(of, WORK, last=nothing, layer_worth=0.0, seed=1, seconds_max=inf)


def lowest(of: HorizonProblem) -> float:
    """The lowest objective of all plans there are [m]."""
    kinds = range(1 + len(of.kinds))
    values = [[value for value in kinds if value == 0 or places >> (value - 1) & 1] for places in of.choices.ravel()]
    plans = (np.array(plan, np.int32).reshape(of.choices.shape) for plan in product(*values))
    return min(bindings.objective(of, plan).value for plan in plans)


def test_no_plan_is_better_than_full_layers_that_are_printed_without_a_search() -> None:
    rng = np.random.default_rng(7)
    proven = 0
    for _ in range(120):
        drawn = problem(rng)
        found = planned(drawn)
        if found.sweeps > 0 or found.status is PlanStatus.DONE:
            continue
        proven += 1
        assert (found.start, found.status) == ("full layers", PlanStatus.REPAIRED)
        assert found.objective.value <= lowest(drawn) + 1e-15
    assert 10 < proven < 110


def test_the_largest_drop_is_the_one_of_a_full_layer() -> None:
    wanted = np.full((1, 5, 5), 2, np.int32)
    far = HorizonProblem(
        np.zeros((5, 5)), np.full((5, 5), 1e-4), np.ones((5, 5), np.bool_), np.full((1, 5, 5), 3, np.uint16),
        TWO_SIZES, 0.8,
    )  # fmt: skip
    assert np.array_equal(planned(far).plan, wanted)
    assert planned(far).sweeps == 0


@pytest.mark.parametrize(
    "near",
    [
        {"target": np.full((5, 5), 7e-6)},  # a layer is more than enough
        {"ceiling": np.full((5, 5), 5e-6), "ceiling_cost": 100.0},
        {"kinds": (INK, replace(INK, h2=1.5 * INK.h2)), "choices": np.full((1, 5, 5), 3, np.uint16)},  # two inks
        {"kinds": (Ink(1e-6, 2e-6, 2e-6),)},  # more ink may lower a cell
    ],
)
def test_where_a_droplet_can_do_harm_the_plan_is_searched(near: dict[str, Any]) -> None:
    far = HorizonProblem(
        np.zeros((5, 5)), np.full((5, 5), 1e-4), np.ones((5, 5), np.bool_), np.ones((1, 5, 5), np.uint16), (INK,), 0.8
    )
    assert planned(far).sweeps == 0
    assert planned(replace(far, **near)).sweeps > 0
