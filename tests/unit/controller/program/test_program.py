"""The layer problem as a program: built once, the same statement for every engine, bounds only where they hold."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import casadi as ca
import numpy as np
import pytest

from inkloop.component import Ink
from inkloop_controller.core import bindings
from inkloop_controller.problem.horizon_problem import HorizonProblem
from inkloop_controller.program import statement
from inkloop_controller.program.program import HorizonProgram
from support.smoothed_cost import smoothed_cost

EVERY_3_BY_3 = [np.reshape(bits, (1, 3, 3)).astype(np.int32) for bits in product((0, 1), repeat=9)]


def rough(shape: tuple[int, int], layers: int = 1, seed: int = 0, **values: Any) -> HorizonProblem:
    height = np.random.default_rng(seed).uniform(0.0, 8e-6, shape)
    target = np.full(shape, height.mean() + 3.8e-6 * layers)
    choices = np.ones((layers, *shape), np.uint16)
    problem = HorizonProblem(height, target, np.ones(shape, np.bool_), choices, (Ink(),), 1.0)
    return replace(problem, **values)


def least(problem: HorizonProblem) -> float:
    return min(bindings.objective(problem, plan).value for plan in EVERY_3_BY_3)


@pytest.mark.parametrize("seed", range(4))
def test_bound_is_below_every_plan(seed: int) -> None:
    plain = rough((3, 3), seed=seed)
    both = replace(plain, overshoot=3.0, ceiling=plain.target + 1e-6, ceiling_cost=10.0)
    for problem in (plain, both, replace(both, alpha=0.5), replace(both, alpha=0.1)):
        found = HorizonProgram(problem, "ipopt").solve(problem)
        assert found.solved
        assert found.bound <= least(problem)


@pytest.mark.parametrize("seed", range(4))
def test_whole_droplets_reach_the_best_plan(seed: int) -> None:
    plain = rough((3, 3), seed=seed)
    for problem in (plain, replace(plain, overshoot=3.0, ceiling=plain.target + 1e-6, ceiling_cost=10.0)):
        found, best = HorizonProgram(problem, "highs", whole=True).solve(problem), least(problem)
        assert found.value == pytest.approx(best, rel=1e-4, abs=0.0)
        assert found.bound <= best
        assert found.bound == pytest.approx(best, rel=1e-3, abs=0.0)


@pytest.mark.parametrize("seed", range(3))
def test_engines_agree_where_both_apply(seed: int) -> None:
    problem = rough((7, 5), seed=seed, overshoot=2.0)
    one, other = (HorizonProgram(problem, engine).solve(problem) for engine in ("ipopt", "highs"))
    assert one.value == pytest.approx(other.value, rel=1e-5, abs=0.0)
    assert one.bound == pytest.approx(other.bound, rel=1e-5, abs=0.0)


def test_value_is_that_of_the_droplets() -> None:
    for layers, alpha in product((1, 2), (1.0, 0.3)):
        problem = rough((5, 4), layers, alpha=alpha)
        found = HorizonProgram(problem, "ipopt").solve(problem)
        expected, _ = smoothed_cost(problem)(found.droplets, 0.0)
        assert found.value == pytest.approx(expected, abs=1e-15)


def test_longer_horizon_has_no_bound() -> None:
    order = ((0, 3, 1, 2),)
    two_kinds = rough((3, 3), kinds=(Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6)), choices=np.full((1, 3, 3), 3, np.uint16))
    for problem in (rough((3, 3), 2), rough((3, 3), colours=order), two_kinds):
        found = HorizonProgram(problem, "ipopt").solve(problem)
        assert np.isnan(found.bound)
        assert found.value >= 0.0


def test_program_is_built_once(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = 0
    build = statement.symbolic_layer

    def counted(H: Any, *others: Any) -> Any:
        nonlocal calls
        calls += isinstance(H, ca.MX)
        return build(H, *others)

    monkeypatch.setattr(statement, "symbolic_layer", counted)
    first = rough((4, 4), 2, alpha=0.7)
    program = HorizonProgram(first, "ipopt")
    built = calls
    for seed in range(3):
        program.solve(rough((4, 4), 2, seed, alpha=0.2 + 0.2 * seed, overshoot=1.0 + seed))
    assert built == 2
    assert calls == built


def test_program_gives_the_same_answer_whatever_it_solved_before() -> None:
    first, second = rough((4, 4), seed=1, alpha=0.7), rough((4, 4), seed=2, alpha=0.4)
    program = HorizonProgram(first, "ipopt")
    program.solve(first)
    assert program.solve(second).value == pytest.approx(
        HorizonProgram(second, "ipopt").solve(second).value, rel=1e-6, abs=0.0
    )


def test_dead_cells_get_no_droplet() -> None:
    problem = rough((4, 4), choices=np.eye(4, dtype=np.uint16)[None])
    for engine in ("ipopt", "highs"):
        droplets = HorizonProgram(problem, engine).solve(problem).droplets
        assert (droplets[problem.choices == 0] == 0.0).all()
        assert droplets.max() <= 1.0


def test_problems_and_engines_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match="engine 'highs' with 2 layers"):
        HorizonProgram(rough((3, 3), 2), "highs")
    with pytest.raises(ValueError, match=r"alpha 0\.5; a linear program needs"):
        HorizonProgram(rough((3, 3), alpha=0.5), "highs")
    with pytest.raises(ValueError, match="with whole droplets"):
        HorizonProgram(rough((3, 3)), "ipopt", whole=True)
    with pytest.raises(ValueError, match="build another HorizonProgram"):
        HorizonProgram(rough((3, 3)), "ipopt").solve(rough((3, 4)))
