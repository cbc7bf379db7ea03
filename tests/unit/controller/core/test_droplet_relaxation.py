"""Relaxed droplets: the core's surface, its gradient, its optimum, and the plans that error diffusion makes of them."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from inkloop.component import Ink
from inkloop_controller.core import bindings
from inkloop_controller.core.bindings import diffuse
from inkloop_controller.problem.horizon_problem import HorizonProblem
from inkloop_controller.program.program import HorizonProgram
from inkloop_controller.program.statement import drop_limits
from support.core_search import relax
from support.numpy import relaxation_numpy
from support.smoothed_cost import smoothed_cost

INKS = (Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6))
GREY = tuple(Ink(k * Ink().h1, k * Ink().h2, k * Ink().h3) for k in (1, 2, 3))
ORDER = (0, 3, 1, 2)


def rough(shape: tuple[int, int], layers: int, passes: int = 1, seed: int = 0, **values: Any) -> HorizonProblem:
    """A rough surface with a flat target that takes half of all droplets."""
    height = np.random.default_rng(seed).uniform(0.0, 8e-6, shape)
    whole: dict[str, Any] = {
        "target": np.full(shape, height.mean() + 3.8e-6 * layers),
        "part": np.ones(shape, np.bool_),
        "choices": np.ones((layers, *shape), np.uint16),
        "kinds": (Ink(),),
        "alpha": 1.0,
        "colours": tuple(ORDER[first:] + ORDER[:first] for first in range(layers)) if passes == 4 else (),
    }
    return HorizonProblem(height, **{**whole, **values})


def uneven(layers: int, passes: int, seed: int) -> HorizonProblem:
    """Two inks, dead cells, a part with a fringe, a ceiling: all that an objective may have."""
    rng = np.random.default_rng(seed)
    shape = (6, 7)
    problem = rough(shape, layers, passes, seed)
    return replace(
        problem,
        part=rng.random(shape) < 0.8,
        choices=rng.integers(0, 3, (layers, *shape), np.uint16),
        kinds=INKS,
        alpha=0.3,
        weight=rng.random(shape),
        overshoot=2.0,
        ceiling=problem.target + 0.5e-6,
        ceiling_cost=3.0,
    )


@pytest.mark.parametrize("passes", [1, 4])
@pytest.mark.parametrize("layers", [1, 2, 3])
def test_whole_droplets_cost_what_their_plan_costs(layers: int, passes: int) -> None:
    for seed in range(3):
        problem = uneven(layers, passes, seed)
        chosen = np.random.default_rng(seed).random(problem.choices.shape) < 0.5
        plan = np.where(chosen, problem.choices, 0).astype(np.int32)
        value, _ = smoothed_cost(problem)((plan > 0).astype(float), 0.0)
        assert value == pytest.approx(bindings.objective(problem, plan).value, abs=1e-15)


@pytest.mark.parametrize("shape", [(3, 129), (129, 3), (4, 300)])
def test_relaxed_cost_of_whole_droplets_is_that_of_their_plan_on_wide_grids(shape: tuple[int, int]) -> None:
    """Rows are taken in bands of 128 columns."""
    problem = rough(shape, 2)
    plan = np.random.default_rng(1).integers(0, 2, problem.choices.shape, np.int32)
    found = relax(problem, plan.astype(np.float64), iterations_max=0)
    assert found.value == pytest.approx(bindings.objective(problem, plan).value, rel=1e-2, abs=0.0)


@pytest.mark.parametrize("passes", [1, 4])
@pytest.mark.parametrize("layers", [1, 2, 3])
def test_value_and_first_step_are_those_of_the_statement(layers: int, passes: int) -> None:
    """A step goes along the gradient, so far that many droplets end at a limit: the others show it."""
    for seed in range(3):
        problem = uneven(layers, passes, seed)
        start, limits = np.random.default_rng(seed).random(problem.choices.shape), drop_limits(problem)
        cost, (first, last) = smoothed_cost(problem), relaxation_numpy.smoothings(problem)
        found = relax(problem, start, iterations_max=0)
        assert found.value == pytest.approx(cost(start * limits, last)[0], rel=1e-12, abs=0.0)
        stepped = relax(problem, start, iterations_max=1)
        moved = -relaxation_numpy.step(problem, first) * cost(start * limits, first)[1]
        assert (stepped.droplets == found.droplets).mean() < 0.9
        np.testing.assert_allclose(stepped.droplets, np.clip(start * limits + moved, 0.0, limits), rtol=0.0, atol=1e-9)
        inside = (stepped.droplets > 0.0) & (stepped.droplets < limits)
        assert inside.sum() > 0.1 * limits.sum()


@pytest.mark.parametrize(("layers", "passes"), [(1, 1), (2, 1), (3, 4)])
def test_descent_is_that_of_its_numpy_statement(layers: int, passes: int) -> None:
    """A problem with everything, and an even one, where the momentum leads uphill."""
    start = np.random.default_rng(layers).random((layers, 6, 7))
    for problem in (uneven(layers, passes, 1), rough((6, 7), layers, passes, kinds=GREY, alpha=0.5)):
        found = relax(problem, start, iterations_max=25)
        droplets, value = relaxation_numpy.relaxed(problem, start, 25, smoothed_cost(problem))
        np.testing.assert_allclose(found.droplets, droplets, rtol=0.0, atol=1e-7)
        assert found.value == pytest.approx(value, rel=1e-9, abs=0.0)


@pytest.mark.parametrize("seed", range(4))
def test_error_diffusion_is_that_of_its_numpy_statement(seed: int) -> None:
    rng = np.random.default_rng(seed)
    grey = rough((9, 8), 2, kinds=GREY, choices=rng.integers(0, 8, (2, 9, 8)).astype(np.uint16))
    odd = replace(grey, kinds=(Ink(), Ink(1e-6, 0.1e-6, 0.05e-6), Ink(7.4e-6, 1e-6, 0.3e-6)))  # of 1, 1 and 2 droplets
    for problem in (uneven(3, 1, seed), grey, odd, rough((12, 11), 1)):
        droplets = rng.uniform(0.0, 1.2, problem.choices.shape) * relaxation_numpy.most(problem)
        np.testing.assert_array_equal(diffuse(problem, droplets), relaxation_numpy.diffused(problem, droplets))


def test_error_of_many_rows_stays_in_their_thirty_second_part() -> None:
    """Where droplets may fall everywhere."""
    rows = 1024 + 13
    droplets = np.random.default_rng(1).random((1, rows, 3))
    ends = [rows * part // 32 for part in range(33)]
    expected = [
        relaxation_numpy.diffused(rough((bottom - top, 3), 1), droplets[:, top:bottom])
        for top, bottom in pairwise(ends)
    ]
    np.testing.assert_array_equal(diffuse(rough((rows, 3), 1), droplets), np.concatenate(expected, axis=1))


def test_start_that_is_better_is_kept() -> None:
    """The first step is that of a smoother objective."""
    problem = rough((8, 8), 1, alpha=0.5)
    best = relax(problem, iterations_max=60)
    again = relax(problem, best.droplets, iterations_max=1)
    assert again.value == best.value
    np.testing.assert_array_equal(again.droplets, best.droplets)


@pytest.mark.parametrize("seed", range(3))
def test_gradients_end_near_the_optimum_of_a_convex_problem(seed: int) -> None:
    for problem in (rough((8, 8), 1, seed=seed), rough((8, 8), 1, seed=seed, alpha=0.5, overshoot=3.0)):
        best = HorizonProgram(problem, "ipopt").solve(problem)
        value, _ = smoothed_cost(problem)(relax(problem).droplets, 0.0)
        assert best.solved
        assert best.bound <= value <= best.value + 0.01e-6


def test_start_beyond_the_choices_is_brought_within_them_before_the_first_step() -> None:
    problem = uneven(2, 1, 1)
    limits = drop_limits(problem)
    for start in (-0.5, 1.5):
        found = relax(problem, np.full(problem.choices.shape, start), iterations_max=0)
        np.testing.assert_array_equal(found.droplets, np.clip(start, 0.0, limits))
    assert set(limits.flat) == {0.0, 1.0}
    kinds = (Ink(), Ink(1e-6, 0.1e-6, 0.05e-6), Ink(7.4e-6, 1e-6, 0.3e-6))  # of 7.6, 1.6 and 12.6 um in all
    choices = np.array([[[1, 2, 3, 4, 5, 6, 0]]], np.uint16)
    of = rough((1, 7), 1, kinds=kinds, choices=choices)
    most = relax(of, np.full((1, 1, 7), 99.0), iterations_max=0).droplets
    np.testing.assert_array_equal(most[0, 0], [1, 1, 1, 1, 2, 8, 0])
    np.testing.assert_array_equal(drop_limits(of), most)


def test_relaxation_stops_with_its_budget() -> None:
    problem = rough((6, 6), 2)
    assert relax(problem, iterations_max=0).iterations == 0
    assert relax(problem, iterations_max=7).iterations == 7
    assert relax(problem, iterations_max=7, seconds_max=0.0).iterations == 0
    with pytest.raises(ValueError, match="start has shape"):
        relax(problem, np.zeros((6, 6)))


@pytest.mark.parametrize("passes", [1, 4])
@pytest.mark.parametrize("shape", [(260, 98), (97, 260)])
def test_any_number_of_threads_relaxes_to_the_same_bits(shape: tuple[int, int], passes: int) -> None:
    wanted = rough(shape, 2, passes, alpha=0.7)
    one, *more = (relax(wanted, iterations_max=3, threads=threads) for threads in (1, 2, 3))
    for other in more:
        assert (other.value, other.iterations) == (one.value, one.iterations)
        np.testing.assert_array_equal(other.droplets, one.droplets)
