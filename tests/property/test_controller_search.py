"""Laws of the search core on any small grid."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from inkloop.component import Ink
from inkloop_controller import core
from inkloop_controller.core import LayerProblem
from inkloop_controller.layer_plan import layer_objective

INKS = (Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6))


@st.composite
def problems(draw: st.DrawFn) -> tuple[LayerProblem, Any]:
    """A layer problem with a part, forbidden cells and two inks, and a start pattern."""
    shape = (draw(st.integers(1, 7)), draw(st.integers(1, 7)))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    part = rng.random(shape) < draw(st.sampled_from([0.5, 0.9, 1.0]))
    part.flat[0] = True
    allowed = part & (rng.random(shape) < draw(st.sampled_from([0.7, 1.0])))
    height = rng.uniform(0.0, draw(st.sampled_from([0.0, 1e-6, 2e-5])), shape) + draw(st.sampled_from([0.0, 4e-4]))
    target = height.mean() + rng.uniform(-1e-5, 2e-5, shape)
    material = rng.integers(0, 2, shape, dtype=np.int32)
    alpha = draw(st.sampled_from([0.0, 0.1, 0.5, 0.8, 1.0]))
    start = (rng.integers(0, 2, shape) * allowed).astype(np.int32)
    return LayerProblem(height, target, part, allowed, material, INKS, alpha), start


def evaluated(problem: LayerProblem, pattern: Any) -> float:
    """The objective from the predicted surface, without the core's sums."""
    inked = np.where(pattern > 0, 1 + problem.material, 0).astype(np.int32)
    after = core.layer(problem.height, inked, INKS)
    return layer_objective(after, problem.target, problem.part, problem.alpha)


@given(problems())
@settings(deadline=None, max_examples=200)
def test_objective_is_that_of_the_predicted_surface(case: tuple[LayerProblem, Any]) -> None:
    problem, start = case
    assert core.objective(problem, start) == pytest.approx(evaluated(problem, start), rel=1e-9, abs=1e-16)
    found = core.search(problem, start, 100)
    assert found.objective == pytest.approx(evaluated(problem, found.pattern), rel=1e-9, abs=1e-16)
    assert found.incremental == pytest.approx(found.objective, rel=1e-6, abs=1e-13)


@given(problems())
@settings(deadline=None, max_examples=200)
def test_search_never_ends_worse_than_it_began(case: tuple[LayerProblem, Any]) -> None:
    problem, start = case
    before = core.objective(problem, start)
    assert core.search(problem, start, 100).objective <= before + 1e-18
    assert core.paper_search(problem, start, 8, 1000, 1).objective <= before + 1e-18


@given(problems(), st.integers(0, 2**64 - 1))
@settings(deadline=None, max_examples=100)
def test_same_problem_and_seed_give_the_same_pattern(case: tuple[LayerProblem, Any], seed: int) -> None:
    problem, start = case
    kept = start.copy()
    one, other = (core.search(problem, start, 100, annealing_sweeps=5, seed=seed) for _ in range(2))
    np.testing.assert_array_equal(one.pattern, other.pattern)
    np.testing.assert_array_equal(start, kept)


@given(problems())
@settings(deadline=None, max_examples=100)
def test_droplets_keep_to_allowed_cells_and_materials(case: tuple[LayerProblem, Any]) -> None:
    problem, start = case
    for found in (core.search(problem, start, 100), core.paper_search(problem, start, 8, 1000, 1)):
        assert not found.pattern[~problem.allowed].any()
        droplets = found.pattern > 0
        np.testing.assert_array_equal(found.pattern[droplets], 1 + problem.material[droplets])
