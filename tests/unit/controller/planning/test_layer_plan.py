"""A plan: its gap, its table and picture, and the objective of a surface."""

from __future__ import annotations

from dataclasses import replace
from math import inf, isnan, nan
from typing import Any

import numpy as np
import pytest

from inkloop.component import Ink
from inkloop_controller.planning.layer_plan import LayerPlan, LeftOut, PlanStatus, surface_objective
from inkloop_controller.problem.criterion import Work
from inkloop_controller.problem.horizon_problem import HorizonProblem, Objective
from support.problem_plans import best_plan

PATTERN = np.array([[0, 1, 2], [2, 0, 2]], np.int32)
SURFACE: Any = PATTERN * 1e-5
PLAN = replace(
    LayerPlan.of_pattern(
        PATTERN, Objective(4e-6, 3e-6, 2e-6, 1e-6), SURFACE, PlanStatus.BUDGET, "last plan", 7
    ),
    plan=np.array([PATTERN, [[1, 0, 0], [0, 0, 0]]], np.int32),
)  # fmt: skip


def test_plan_of_a_pattern_is_one_layer_of_single_drops() -> None:
    plan = LayerPlan.of_pattern(PATTERN, PLAN.objective, SURFACE, PlanStatus.FIXED, "rule")
    np.testing.assert_array_equal(plan.plan, [PATTERN])
    np.testing.assert_array_equal(plan.pattern, PATTERN)
    np.testing.assert_array_equal(plan.drop_level, [[0, 1, 1], [1, 0, 1]])
    assert (plan.status, plan.start, plan.sweeps, plan.left_out) == (PlanStatus.FIXED, "rule", 0, LeftOut.NOTHING)
    assert isnan(plan.bound)
    assert plan.bound_confidence == 1.0


@pytest.mark.parametrize(
    ("value", "bound", "gap"),
    [(4e-6, 3e-6, 0.25), (4e-6, 4e-6, 0.0), (4e-6, 5e-6, 0.0), (0.0, 0.0, 0.0), (0.0, -1e-6, inf), (4e-6, nan, nan)],
)
def test_gap_is_the_excess_over_the_bound_as_a_share_of_the_objective(value: float, bound: float, gap: float) -> None:
    plan = replace(PLAN, objective=Objective(value, 0.0, 0.0, 0.0), bound=bound)
    assert plan.gap == pytest.approx(gap, rel=1e-12, abs=0.0, nan_ok=True)


def test_table_of_a_plan_has_its_figures() -> None:
    table = PLAN._repr_html_()
    for name, value in {
        "status": "budget", "layers ahead": "2", "droplets by layer": "4, 1",
        "objective after the last layer": "4 µm", "start": "last plan", "sweeps": "7",
    }.items():  # fmt: skip
        assert f"<th>{name}</th><td>{value}</td>" in table
    assert "left out" not in table
    assert "no plan is below" not in table
    cut = replace(PLAN, left_out=LeftOut.STARTS | LeftOut.CERTIFICATE, bound=3e-6)._repr_html_()
    assert "<th>left out by the time limit</th><td>starts, certificate</td>" in cut
    assert "<th>no plan is below</th><td>3 µm (gap 25.00%)</td>" in cut


def test_picture_of_a_plan_has_its_droplets_and_the_expected_surface() -> None:
    figure = PLAN.plot()
    first, second, surface, bar = figure.axes
    for axes, layer in zip((first, second), PLAN.plan, strict=True):
        shown: Any = axes.images[0].get_array()
        np.testing.assert_array_equal(shown.filled(0), layer.T)
        assert axes.images[0].get_clim() == (0, 2)
    assert [axes.get_title() for axes in (first, second, surface)] == [
        "layer 1: 4 droplets", "layer 2: 1 droplets", "expected after layer 1"
    ]  # fmt: skip
    heights: Any = surface.images[0].get_array()
    np.testing.assert_allclose(heights, SURFACE.T * 1e6, rtol=1e-12)
    assert all(axes.images[0].origin == "lower" for axes in (first, second, surface))
    assert bar.get_ylabel() == "height [µm]"
    assert figure.get_suptitle() == "budget, objective 4 µm"


def test_objective_of_a_surface_weighs_mean_error_and_deviation_over_the_part() -> None:
    height = np.array([[1.0, 5.0, 90.0], [3.0, 7.0, 80.0]]) * 1e-6
    target = np.array([[4.0, 4.0, 0.0], [4.0, 4.0, 0.0]]) * 1e-6
    part = np.array([[True, True, False], [True, True, False]])
    found = surface_objective(height, target, part, 0.3)
    assert found.error == pytest.approx(2e-6, rel=1e-9, abs=0.0)
    deviation = np.sqrt(5.0) * 1e-6
    assert found.deviation == pytest.approx(deviation, rel=1e-9, abs=0.0)
    assert found.value == pytest.approx(0.3 * 2e-6 + 0.7 * deviation, rel=1e-9, abs=0.0)


def test_plan_that_is_made_of_a_longer_one_is_not_said_to_be_made_of_the_last() -> None:
    """There is no last plan; two layers do as well as the three of the horizon."""
    height = np.random.default_rng(0).uniform(0.0, 8e-6, (14, 13))
    target, everywhere = np.full(height.shape, height.mean() + 12e-6), np.ones(height.shape, np.bool_)
    problem = HorizonProblem(height, target, everywhere, np.ones((3, *height.shape), np.uint16), (Ink(),), 0.8)
    none = np.zeros((0, *height.shape), np.int32)
    work = Work(sweeps=4, annealing_sweeps=0, iterations=3)
    found = best_plan(problem, work, last=none, layer_worth=0.001, seed=1, seconds_max=inf)
    assert not found.plan[2].any()
    assert found.start == "longer plan"
