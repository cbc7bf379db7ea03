"""The relaxed layer problem by a sequence of linear programs: the linearisation, the tangents, and what comes out."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest

from inkloop.component import Ink
from inkloop_controller.problem.horizon_problem import HorizonProblem, even_droplets
from inkloop_controller.program import linear_step, sequential_program
from inkloop_controller.program.linear_step import LinearProgram, Point, as_cells
from inkloop_controller.program.program import HorizonProgram
from inkloop_controller.program.sequential_program import SequentialProgram
from inkloop_controller.program.statement import drop_limits, exact_cost, numbers_of
from support.core_search import relax
from support.layer_problems import nearly_flat, rough, with_everything
from support.smoothed_cost import smoothed_cost

TOLERANCE_UM = 1e-7  # of interior points
GREY = tuple(Ink(k * Ink().h1, k * Ink().h2, k * Ink().h3) for k in (1, 2, 3))
EVERY = [with_everything((6, 7), layers, passes, 1) for layers, passes in product((1, 2, 3), (1, 4))]


def cost(problem: HorizonProblem, droplets: Any) -> float:
    """True objective of droplets [m], of any size."""
    return smoothed_cost(problem)(droplets, 0.0)[0]


def around(problem: HorizonProblem, droplets: Any) -> tuple[LinearProgram, Point]:
    program = LinearProgram(problem, tangents_max=2)
    return program, program.point(numbers_of(problem), [as_cells(U) for U in droplets])


@pytest.mark.parametrize("seed", range(4))
def test_one_layer_with_alpha_1_ends_at_the_optimum_of_its_linear_program(seed: int) -> None:
    plain = rough((6, 6), seed=seed)
    for problem in (
        plain,
        nearly_flat((6, 6), seed=seed, overshoot=2.0),
        with_everything((6, 6), 1, 1, seed, alpha=1.0),
    ):
        found = SequentialProgram(problem).solve(problem)
        assert found.solved
        assert found.value == pytest.approx(HorizonProgram(problem, "highs").solve(problem).value, abs=1e-12)


@pytest.mark.parametrize("alpha", [0.8, 0.3, 0.0])
def test_one_layer_ends_at_the_optimum_that_ipopt_finds(alpha: float) -> None:
    """It is convex there. Some nanometres: IPOPT smooths the deviation, and steps that gain little are not made."""
    for problem in (rough((8, 8), alpha=alpha), nearly_flat((8, 8), alpha=alpha)):
        found, best = (one.solve(problem) for one in (SequentialProgram(problem), HorizonProgram(problem, "ipopt")))
        assert best.solved
        assert found.value == pytest.approx(best.value, rel=2e-3, abs=2e-9)


@pytest.mark.parametrize("alpha", [1.0, 0.8])
@pytest.mark.parametrize("seed", range(2))
def test_two_layers_end_no_higher_than_projected_gradients(seed: int, alpha: float) -> None:
    for problem in (rough((10, 10), 2, seed, alpha=alpha), nearly_flat((10, 10), 2, seed, alpha=alpha)):
        found = SequentialProgram(problem).solve(problem)
        for iterations in (10, 30):  # those of a plan, and as many as bring something
            other = relax(problem, even_droplets(problem), iterations_max=iterations).droplets
            assert found.value <= cost(problem, other) + 1e-9


@pytest.mark.parametrize("problem", EVERY, ids=lambda problem: f"{problem.layers} layers, {problem.passes} passes")
def test_droplets_are_allowed_better_than_the_start_and_worth_what_is_said(problem: HorizonProblem) -> None:
    found, limits = SequentialProgram(problem).solve(problem), drop_limits(problem)
    assert found.solved
    assert np.isnan(found.bound)
    assert (found.droplets >= 0.0).all()
    assert (found.droplets <= limits).all()
    assert found.value == pytest.approx(exact_cost(numbers_of(problem), list(found.droplets)) * 1e-6, rel=1e-9, abs=0.0)
    assert found.value < exact_cost(numbers_of(problem), list(even_droplets(problem))) * 1e-6


def test_droplets_of_several_sizes_are_used_up_to_the_largest() -> None:
    choices = np.full((2, 6, 6), 0b111, np.uint16)
    problem = rough((6, 6), 2, kinds=GREY, choices=choices, target=np.full((6, 6), 80e-6))
    assert SequentialProgram(problem).solve(problem).droplets == pytest.approx(np.full((2, 6, 6), 3.0), abs=1e-9)


@pytest.mark.parametrize("problem", EVERY, ids=lambda problem: f"{problem.layers} layers, {problem.passes} passes")
def test_derivatives_are_those_of_finite_differences(problem: HorizonProblem) -> None:
    """Of the last surface by the droplets of each layer, through all surfaces between; at kinks they need not agree."""
    limits, rng, size = drop_limits(problem), np.random.default_rng(2), 1e-6
    droplets = limits * rng.uniform(0.2, 0.8, limits.shape)
    direction = limits * rng.uniform(-1.0, 1.0, limits.shape)
    program, point = around(problem, droplets)
    change: Any = np.zeros(problem.part.size)
    for step, by_droplets in enumerate(point.by_droplets):
        own = by_droplets @ as_cells(direction[step * problem.layers // len(point.by_droplets)])
        change = np.asarray(own).ravel() + np.asarray(point.by_surface[step] @ change).ravel()
    up, down = (
        program.point(numbers_of(problem), [as_cells(U) for U in droplets + sign * size * direction]).surfaces[-1]
        for sign in (1.0, -1.0)
    )
    expected = (up - down) / (2.0 * size)
    np.testing.assert_allclose(change, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())


def test_promise_of_a_small_step_is_kept_and_that_of_a_large_one_is_not() -> None:
    """The error of the linearised map falls with the square of the step, on a surface without kinks near by."""
    problem = nearly_flat((8, 8), 2)
    program, point = around(problem, np.full((2, 8, 8), 0.5))
    wrong = []
    for radius in (0.5, 0.05, 0.005):
        step = program.step(numbers_of(problem), point, radius, [])
        assert step is not None
        assert max(float(np.abs(U - 0.5).max()) for U in step.droplets) <= radius + 1e-9
        assert step.promised < point.value
        wrong.append(program.point(numbers_of(problem), step.droplets).value - step.promised)
    assert wrong[0] > 0.1
    assert abs(wrong[1]) < wrong[0] / 20
    assert abs(wrong[2]) < wrong[0] / 1000


def test_deviation_is_promised_by_a_parabola_that_tangents_hold_up_from_below() -> None:
    """One layer in one pass: the map is linear, and what is promised is wrong by the tangents alone."""
    problem = nearly_flat((7, 7), 1, alpha=0.2)
    numbers, program = numbers_of(problem), LinearProgram(problem, tangents_max=30)
    point = program.point(numbers, [np.full(49, 0.4)])
    touching, promises = [program.off_mean(point.surfaces[-1])], []
    width = touching[0].std()
    for radius in (0.0, *[0.5] * 20):
        step = program.step(numbers, point, radius, touching)
        assert step is not None
        deviation = program.off_mean(step.surface).std()
        parabola = step.linear + 0.8 * ((deviation**2 / width + width) / 2 - deviation)
        assert step.promised <= parabola + TOLERANCE_UM
        touching.append(program.off_mean(step.surface))
        promises.append(step.promised)
    assert promises[0] == pytest.approx(point.value, rel=1e-6, abs=0.0)
    assert promises[1] < parabola - 0.1
    assert np.diff(promises[1:]).min() > -1e-6
    assert promises[-1] == pytest.approx(parabola, rel=1e-4, abs=0.0)


def test_objective_only_falls(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = with_everything((6, 7), 3, 4, 2)
    values = []
    for programs in (1, 2, 4, 8, 16):
        monkeypatch.setattr(sequential_program, "PROGRAMS_MAX", programs)
        values.append(SequentialProgram(problem).solve(problem).value)
    assert values == sorted(values, reverse=True)
    assert values[-1] < values[0]


def test_radius_grows_where_promises_are_kept_and_shrinks_where_they_are_not(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a nearly flat surface both happen; no step is longer than its radius."""
    problem, radii = nearly_flat((8, 8), 3), []
    step = LinearProgram.step

    def watched(self: LinearProgram, numbers: Any, around: Point, radius: float, touching: Any) -> Any:
        found = step(self, numbers, around, radius, touching)
        radii.append(radius)
        assert found is not None
        for before, after in zip(around.droplets, found.droplets, strict=True):
            assert np.abs(before - after).max() <= radius + 1e-9
        return found

    monkeypatch.setattr(LinearProgram, "step", watched)
    SequentialProgram(problem).solve(problem)
    assert np.diff(radii).max() > 0.0 > np.diff(radii).min()


def test_time_limit_leaves_the_best_so_far() -> None:
    problem = nearly_flat((8, 8), 3)
    none = SequentialProgram(problem, seconds_max=0.0).solve(problem)
    np.testing.assert_array_equal(none.droplets, even_droplets(problem))
    assert not none.solved
    assert none.message == "time limit"
    assert none.value == pytest.approx(cost(problem, none.droplets), rel=1e-9, abs=0.0)


def test_simplex_takes_over_where_interior_points_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    """And where that fails, too, the start is left."""
    problem, usual = nearly_flat((7, 7), 2), linear_step.METHODS
    lame = {"solver": "ipm", "run_crossover": "off", "ipm_iteration_limit": 1}
    expected = SequentialProgram(problem).solve(problem)
    monkeypatch.setattr(linear_step, "METHODS", (lame, usual[1]))
    found = SequentialProgram(problem).solve(problem)
    assert found.solved
    assert found.value == pytest.approx(expected.value, rel=1e-3, abs=0.0)
    monkeypatch.setattr(linear_step, "METHODS", (lame,))
    left = SequentialProgram(problem).solve(problem)
    assert not left.solved
    np.testing.assert_array_equal(left.droplets, even_droplets(problem))


def test_program_that_is_used_again_gives_the_same_droplets() -> None:
    first, second = nearly_flat((6, 6), 2, 1, alpha=0.8), rough((6, 6), 2, 2, alpha=0.5)
    program = SequentialProgram(first)
    program.solve(first)
    np.testing.assert_array_equal(program.solve(second).droplets, SequentialProgram(second).solve(second).droplets)
    with pytest.raises(ValueError, match="build another SequentialProgram"):
        program.solve(replace(second, alpha=1.0))
