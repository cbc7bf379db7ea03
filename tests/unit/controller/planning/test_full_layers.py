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
from inkloop_controller.core.bindings import diffuse
from inkloop_controller.planning.horizon_planner import FoundPlan
from inkloop_controller.planning.layer_plan import LeftOut, PlanStatus
from inkloop_controller.problem.criterion import Work
from inkloop_controller.problem.horizon_problem import HorizonProblem, IntPlan, even_droplets, full_layers, no_droplets
from support.core_search import relax, search
from support.layer_problems import INKS, ORDERS, nearly_flat, rough
from support.numpy.plan_starts_numpy import shifted
from support.numpy.relaxation_numpy import dithered
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
        {"target": np.full((5, 5), 8e-6), "alpha": 1.0, "droplet_std": 0.3},  # it may be, where droplets come large
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


def test_cell_that_counts_for_nothing_may_be_higher_than_its_target() -> None:
    height, part = np.zeros((5, 5)), np.ones((5, 5), np.bool_)
    height[0, 0], part[0, 0] = 2e-4, False
    far = HorizonProblem(height, np.full((5, 5), 1e-4), part, part[None].astype(np.uint16), (INK,), 0.8)
    found = planned(far)
    assert (found.sweeps, found.start) == (0, "full layers")
    np.testing.assert_array_equal(found.plan[0], part)
    assert planned(replace(far, part=part | True)).sweeps > 0


def test_full_layers_that_gain_nothing_are_not_printed() -> None:
    """A single cell is even whatever its height."""
    one = np.ones((1, 1), np.bool_)
    even = HorizonProblem(np.zeros((1, 1)), np.full((1, 1), 1e-4), one, one[None].astype(np.uint16), (INK,), 0.0)
    assert planned(even).status is PlanStatus.DONE
    assert planned(replace(even, alpha=0.1)).start == "full layers"


@pytest.mark.parametrize(
    ("shape", "layers", "columns", "sweeps"),
    [
        ((17, 15), 1, 15, 50),
        ((17, 15), 2, 5, 200),  # 170 places
        ((17, 15), 2, 10, 117),  # 340: 40,000 values are drawn
        ((17, 15), 2, 15, 78),
        ((30, 20), 2, 20, 0),  # more than 1,000
        ((30, 20), 2, 8, 83),
    ],
)
def test_annealing_takes_the_sweeps_that_a_plan_of_so_many_places_is_worth(
    shape: tuple[int, int], layers: int, columns: int, sweeps: int
) -> None:
    """Of the places those count where a droplet may fall."""
    choices = np.zeros((layers, *shape), np.uint16)
    choices[..., :columns] = 1
    of, last = rough(shape, layers, choices=choices), np.zeros((0, *shape), np.int32)
    usual, given = (
        best_plan(of, work, relaxed=None, last=last, layer_worth=0.0, seed=3, seconds_max=inf)
        for work in (Work(), Work(annealing_sweeps=sweeps))
    )
    assert usual.sweeps == given.sweeps
    assert usual.sweeps > sweeps
    np.testing.assert_array_equal(usual.plan, given.plan)


THREE_SHARES = (190, 131)  # three shares of rows, of different lengths


def planned_by(threads: int, passes: int) -> FoundPlan:
    height = np.random.default_rng(1).uniform(0.0, 8e-6, THREE_SHARES)
    everywhere, target = np.ones(THREE_SHARES, np.bool_), np.full(THREE_SHARES, height.mean() + 7e-6)
    colours = ((0, 3, 1, 2), (2, 1, 3, 0)) if passes == 4 else ()
    choices = np.ones((2, *THREE_SHARES), np.uint16)
    problem = HorizonProblem(
        height, target, everywhere, choices, (Ink(),), 0.8, ceiling=target + 1e-6, droplet_std=0.1, colours=colours
    )
    last = np.random.default_rng(2).integers(0, 2, choices.shape, dtype=np.int32)
    work = Work(sweeps=1, annealing_sweeps=0, iterations=2, threads=threads)
    return best_plan(problem, work, last=last, layer_worth=0.001, seed=1, seconds_max=inf)


@pytest.mark.parametrize("passes", [1, 4])
def test_any_number_of_threads_makes_the_same_plan(passes: int) -> None:
    one, *more = (planned_by(threads, passes) for threads in (1, 2, 3))
    assert one.plan.any()
    for other in more:
        assert (other.objective, other.start, other.sweeps) == (one.objective, one.start, one.sweeps)
        np.testing.assert_array_equal(other.plan, one.plan)


SHAPE, SWEEPS = (17, 15), 12
SEED = ((2**32 - 1) << 32) + 7  # of the job, and of the layer
ORDER = ((0, 3, 1, 2), (2, 1, 3, 0))


def of_two_layers(passes: int, alpha: float) -> HorizonProblem:
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
    of, last = of_two_layers(passes, alpha), (np.random.default_rng(6).random((1, *SHAPE)) < 0.1).astype(np.int32)
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


DITHERED_SHAPE = (42, 39)
DITHERED_WORK = Work(sweeps=30, annealing_sweeps=0)


def planned_plan(problem: HorizonProblem, last: IntPlan | None = None, **options: Any) -> IntPlan:
    nothing = np.zeros((0, *problem.part.shape), np.int32)
    given = {"seconds_max": inf, "layer_worth": 0.0, "seed": 1, "last": nothing if last is None else last, **options}
    return best_plan(problem, DITHERED_WORK, **given).plan


def repaired(problem: HorizonProblem, start: IntPlan) -> IntPlan:
    return search(problem, start, sweeps_max=DITHERED_WORK.sweeps).plan


def two_inks(shape: tuple[int, int]) -> HorizonProblem:
    choices = np.where(np.arange(shape[1]) < 20, 1, 2) * np.ones((1, *shape), np.int64)
    choices[0, 3, :] = 0
    return nearly_flat(shape, kinds=INKS, choices=choices.astype(np.uint16))


@pytest.mark.parametrize("alpha", [1.0, 0.8])
def test_dithered_droplets_are_repaired_where_they_are_better(alpha: float) -> None:
    for problem in (nearly_flat(DITHERED_SHAPE, alpha=alpha), replace(two_inks(DITHERED_SHAPE), alpha=alpha)):
        even = even_droplets(problem)
        diffusion, dither = repaired(problem, diffuse(problem, even)), repaired(problem, dithered(problem, even))
        np.testing.assert_array_equal(planned_plan(problem), dither)
        assert bindings.objective(problem, dither).value < 0.99 * bindings.objective(problem, diffusion).value


def test_diffused_droplets_are_repaired_where_they_are_better() -> None:
    problem = rough(DITHERED_SHAPE, seed=1)
    np.testing.assert_array_equal(planned_plan(problem), repaired(problem, diffuse(problem, even_droplets(problem))))


def test_droplets_that_are_given_are_dithered_too() -> None:
    problem = nearly_flat(DITHERED_SHAPE)
    given = np.clip(even_droplets(problem) + 0.05, 0.0, 1.0)
    np.testing.assert_array_equal(planned_plan(problem, relaxed=given), repaired(problem, dithered(problem, given)))


def test_last_plan_leaves_diffused_droplets_and_an_empty_one_does_not() -> None:
    problem = nearly_flat(DITHERED_SHAPE)
    empty = np.zeros((1, *DITHERED_SHAPE), np.int32)
    np.testing.assert_array_equal(planned_plan(problem, empty), planned_plan(problem))
    last = empty.copy()
    last[0, 0, 0] = 1
    np.testing.assert_array_equal(
        planned_plan(problem, last), repaired(problem, diffuse(problem, even_droplets(problem)))
    )


def test_relaxed_droplets_of_four_passes_are_dithered() -> None:
    problem = nearly_flat((100, 100), colours=ORDERS[:1])
    relaxed = relax(problem, even_droplets(problem), iterations_max=DITHERED_WORK.iterations).droplets
    np.testing.assert_array_equal(planned_plan(problem), repaired(problem, dithered(problem, relaxed)))


def test_several_layers_are_never_dithered() -> None:
    """Even if nothing may fall in the second one."""
    choices = np.ones((2, 100, 100), np.uint16)
    choices[1] = 0
    problem = nearly_flat((100, 100), 2, choices=choices)
    problem = replace(problem, target=problem.height.mean() + 0.6 * 7.6e-6 * np.ones((100, 100)))
    relaxed = relax(problem, even_droplets(problem), iterations_max=DITHERED_WORK.iterations).droplets
    np.testing.assert_array_equal(planned_plan(problem), repaired(problem, diffuse(problem, relaxed)))


def test_time_limit_that_is_wide_enough_changes_nothing() -> None:
    problem = nearly_flat(DITHERED_SHAPE)
    found = best_plan(
        problem, DITHERED_WORK, last=np.zeros((0, *DITHERED_SHAPE), np.int32), layer_worth=0.0, seed=1, seconds_max=1e6
    )
    np.testing.assert_array_equal(found.plan, planned_plan(problem))
    assert found.left_out == LeftOut.NOTHING
