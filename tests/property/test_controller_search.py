"""Invariants of the search core on any small grid."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from inkloop.component import Ink
from inkloop_controller.core import bindings
from inkloop_controller.problem.horizon_problem import HorizonProblem
from support.core_search import search
from support.examples import examples

KINDS = (Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6), Ink(8.8e-6, 1.2e-6, 0.4e-6))


@st.composite
def problems(draw: st.DrawFn) -> tuple[HorizonProblem, Any]:
    """A problem with a part, forbidden cells, up to three kinds of droplets, layers and passes, and a start."""
    shape = (draw(st.integers(1, 7)), draw(st.integers(1, 7)))
    layers = draw(st.integers(1, 3))
    kinds = KINDS[: draw(st.integers(1, 3))]
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    part = rng.random(shape) < draw(st.sampled_from([0.5, 0.9, 1.0]))
    part.flat[0] = True
    choices = rng.integers(0, 2 ** len(kinds), (layers, *shape)).astype(np.uint16) * part
    height = rng.uniform(0.0, draw(st.sampled_from([0.0, 1e-6, 2e-5])), shape) + draw(st.sampled_from([0.0, 4e-4]))
    colours = tuple(tuple(rng.permutation(4).tolist()) for _ in range(layers)) if draw(st.booleans()) else ()
    problem = HorizonProblem(
        height,
        height.mean() + rng.uniform(-1e-5, 2e-5, shape),
        part,
        choices,
        kinds,
        draw(st.sampled_from([0.0, 0.1, 0.5, 0.8, 1.0])),
        overshoot=draw(st.sampled_from([1.0, 4.0])),
        colours=colours,
        droplet_std=draw(st.sampled_from([0.0, 0.1, 0.3])),
    )
    wished = rng.integers(0, 1 + len(kinds), choices.shape, dtype=np.int32)
    return problem, np.where((2 * choices.astype(np.int32) + 1) >> wished & 1, wished, 0).astype(np.int32)


def kept(height: Any, jetted: Any, kinds: tuple[Ink, ...]) -> Any:
    """Height that each droplet of a step leaves on its own cell, (nx, ny) [m]: it is printed alone."""
    found = np.zeros(height.shape)
    for cell in zip(*np.nonzero(jetted), strict=True):
        alone = np.zeros(height.shape, np.int32)
        alone[cell] = 1
        found[cell] = (bindings.layer(height, alone, (kinds[jetted[cell] - 1],)) - height)[cell]
    return found


def mean_cost(over: Any, bound: Any, overshoot: float) -> Any:
    """Mean cost of errors that are uniform between over - bound and over + bound, from its integral."""
    if not bound.all():
        return np.maximum(-over, overshoot * over)
    high, low = (0.5 * each**2 * np.where(each > 0.0, overshoot, -1.0) for each in (over + bound, over - bound))
    return (high - low) / (2.0 * bound)


def evaluated(problem: HorizonProblem, plan: Any) -> float:
    """The objective from the predicted surface, without the core's sums."""
    height, own = problem.height, np.zeros(problem.height.shape)
    i, j = np.indices(height.shape)
    for layer, pattern in enumerate(plan):
        passes = [[colour] for colour in problem.colours[layer]] if problem.colours else [[0, 1, 2, 3]]
        for colours in passes:
            jetted = np.where(np.isin(2 * (i % 2) + j % 2, colours), pattern, 0)
            own = kept(height, jetted, problem.kinds)
            added = [
                bindings.layer(height, (jetted == 1 + k).astype(np.int32), (kind,)) - height
                for k, kind in enumerate(problem.kinds)
            ]
            height = height + sum(added)
    over = (height - problem.target)[problem.part]
    least = min(kind.h1 for kind in problem.kinds)
    bound = np.sqrt(3.0) * problem.droplet_std * np.maximum(own, least)[problem.part]
    error = mean_cost(over, bound, problem.overshoot).mean()
    deviation = np.sqrt(height[problem.part].var() + (bound**2 / 3.0).mean())
    return float(problem.alpha * error + (1.0 - problem.alpha) * deviation)


@given(problems())
@settings(max_examples=examples(200))
def test_objective_is_that_of_the_predicted_surface(case: tuple[HorizonProblem, Any]) -> None:
    problem, start = case
    assert bindings.objective(problem, start).value == pytest.approx(evaluated(problem, start), rel=1e-9, abs=1e-14)
    found = search(problem, start, sweeps_max=100)
    assert found.objective.value == pytest.approx(evaluated(problem, found.plan), rel=1e-9, abs=1e-14)
    assert found.incremental == pytest.approx(found.objective.value, rel=1e-9, abs=1e-13)


@given(problems(), st.integers(0, 3))
@settings(max_examples=examples(200))
def test_search_never_ends_worse_than_it_began(case: tuple[HorizonProblem, Any], annealing_sweeps: int) -> None:
    problem, start = case
    before = bindings.objective(problem, start).value
    found = search(problem, start, sweeps_max=100, annealing_sweeps=annealing_sweeps)
    assert found.objective.value <= before + 1e-14


@given(problems())
@settings(max_examples=examples(100))
def test_papers_search_never_ends_worse_than_it_began(case: tuple[HorizonProblem, Any]) -> None:
    problem, start = case
    single = problem.choices[:1] & -problem.choices[:1].astype(np.int32)
    problem = replace(problem, choices=single.astype(np.uint16), colours=problem.colours[:1])
    start = np.where((2 * single + 1) >> start[:1] & 1, start[:1], 0).astype(np.int32)
    before = bindings.objective(problem, start).value
    assert bindings.paper_search(problem, start, 8, 1000, 1).objective.value <= before + 1e-14


@given(problems(), st.integers(0, 2**64 - 1))
@settings(max_examples=examples(100))
def test_same_problem_and_seed_give_the_same_plan(case: tuple[HorizonProblem, Any], seed: int) -> None:
    problem, start = case
    kept = start.copy()
    one, other = (search(problem, start, sweeps_max=100, annealing_sweeps=5, seed=seed) for _ in range(2))
    np.testing.assert_array_equal(one.plan, other.plan)
    np.testing.assert_array_equal(start, kept)


@given(problems())
@settings(max_examples=examples(100))
def test_droplets_keep_to_the_choices(case: tuple[HorizonProblem, Any]) -> None:
    problem, start = case
    plan = search(problem, start, sweeps_max=100, annealing_sweeps=2).plan
    assert ((2 * problem.choices.astype(np.int32) + 1) >> plan & 1).all()
