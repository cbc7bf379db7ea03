"""The layer problem as a CasADi function: the objective of the search core, for any solver."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import lsq_linear

from inkloop.units import UM_PER_M
from inkloop_controller.core import bindings
from inkloop_controller.problem.horizon_problem import HorizonProblem
from inkloop_controller.program.layer_function import droplets_of
from support.layer_problems import nearly_flat, random_plan, rough, with_everything
from support.numpy import lu_numpy

PARTS = {"objective": "value", "error": "error", "over_ceiling": "over_ceiling", "deviation": "deviation"}


def answer(function: Any, problem: HorizonProblem, plan: Any) -> dict[str, Any]:
    found: dict[str, Any] = function(droplets=droplets_of(problem, plan), **problem.casadi_values())
    return found


@pytest.mark.parametrize("passes", [1, 4])
@pytest.mark.parametrize("layers", [1, 2, 3, 5])
def test_every_part_of_the_objective_is_that_of_the_search_core(layers: int, passes: int) -> None:
    """Two inks, a fringe, a ceiling; with and without what droplets leave to chance, alone and as the last pass."""
    for seed, droplet_std in product(range(2), (0.0, 0.15)):
        orders = ((0, 3, 1, 2),) * layers if passes == 4 else ()
        problem = with_everything((5, 6), layers, passes, seed, droplet_std=droplet_std, colours=orders)
        function = problem.to_casadi()
        for plan in (random_plan(problem, seed), np.zeros_like(random_plan(problem, seed))):
            found, expected = answer(function, problem, plan), bindings.objective(problem, plan)
            for name, attribute in PARTS.items():
                value = getattr(expected, attribute)
                assert float(found[name]) == pytest.approx(value, rel=1e-9, abs=1e-17), name


def test_surface_is_that_of_the_layer_model() -> None:
    problem = rough((6, 5), 2)
    plan, height = random_plan(problem, 1), problem.height
    for pattern in plan:
        height = bindings.layer(height, pattern, problem.kinds)
    np.testing.assert_allclose(answer(problem.to_casadi(), problem, plan)["surface"], height, rtol=0.0, atol=1e-18)


def test_one_function_serves_every_problem_of_its_shape() -> None:
    first, second = nearly_flat((6, 6), 2, alpha=0.8), rough((6, 6), 2, alpha=0.3, overshoot=2.0, droplet_std=0.1)
    function, plan = first.to_casadi(), random_plan(second, 1)
    expected = bindings.objective(second, plan).value
    assert float(answer(function, second, plan)["objective"]) == pytest.approx(expected, rel=1e-9, abs=0.0)


def test_inputs_have_the_shapes_that_are_documented_and_one_left_out_is_not_taken_for_zero() -> None:
    problem = with_everything((4, 5), 3, 1, 1)
    function = problem.to_casadi()
    sizes = {name: function.size_in(name) for name in function.name_in()}
    maps = dict.fromkeys(("height", "target", "weight", "ceiling"), (4, 5))
    numbers = dict.fromkeys(("alpha", "overshoot", "ceiling_cost", "droplet_std"), (1, 1))
    assert sizes == {"droplets": (4, 3 * 2 * 5), **maps, "ink": (2, 3), **numbers}
    values, plan = problem.casadi_values(), random_plan(problem, 1)
    for name in values:
        others = {other: value for other, value in values.items() if other != name}
        assert np.isnan(float(function(droplets=droplets_of(problem, plan), **others)["objective"])), name


def test_gradient_is_finite_on_a_flat_surface() -> None:
    problem = rough((4, 4), height=np.zeros((4, 4)), target=np.zeros((4, 4)))
    function = problem.to_casadi()
    for alpha, droplet_std in product((1.0, 0.5), (0.0, 0.1)):
        values = replace(problem, alpha=alpha, droplet_std=droplet_std).casadi_values()
        U = ca.MX.sym("U", 4, 4)
        gradient = ca.Function("gradient", [U], [ca.gradient(function(droplets=U, **values)["objective"], U)])
        assert np.isfinite(np.asarray(gradient(np.zeros((4, 4))))).all()


def test_solver_of_ones_own_finds_the_least_squares_of_the_surface() -> None:
    """IPOPT on the surface that the function gives, as on the page, against SciPy on the shares of each droplet."""
    problem = rough((5, 5), seed=3)
    U, shares = ca.MX.sym("U", 5, 5), np.zeros((25, 25))
    surface = problem.to_casadi()(droplets=U, **problem.casadi_values())["surface"]
    off = ca.vec(surface - problem.target) * UM_PER_M
    solver = ca.nlpsol("own", "ipopt", {"x": ca.vec(U), "f": ca.sumsqr(off)}, {"ipopt": {"print_level": 0}})
    found = solver(x0=0.5, lbx=0.0, ubx=1.0)
    for cell, one in enumerate(np.eye(25, dtype=np.int64)):
        shares[:, cell] = (lu_numpy.one_pass(problem.height, one.reshape(5, 5))[0] - problem.height).ravel() * UM_PER_M
    lacking = (problem.target - problem.height).ravel() * UM_PER_M
    best = lsq_linear(shares, lacking, (0.0, 1.0), tol=1e-12)
    assert float(found["f"]) == pytest.approx(2.0 * best.cost, rel=1e-6, abs=1e-9)
