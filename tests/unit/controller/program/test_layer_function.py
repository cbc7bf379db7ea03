"""The layer problem as a CasADi function: the objective of the search core, for any solver."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import casadi as ca
import highspy
import numpy as np
import pytest
from scipy.optimize import lsq_linear

from inkloop.units import UM_PER_M
from inkloop_controller.core import bindings
from inkloop_controller.problem.horizon_problem import HorizonProblem, IntPlan
from inkloop_controller.program.layer_function import droplets_of, expected_size
from inkloop_controller.program.program import HorizonProgram
from inkloop_controller.program.statement import numbers_of
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


SLACK_UM = 1e-9  # of rows, beside 10 um heights


def read_mps(path: Path) -> Any:
    model = highspy.Highs()
    model.setOptionValue("output_flag", False)
    assert model.readModel(str(path)) == highspy.HighsStatus.kOk
    return model


def read_nl(path: Path) -> tuple[Any, list[str], list[str]]:
    """CasADi's reader, and the names of variables and rows."""
    found = ca.NlpBuilder()
    found.import_nl(str(path))
    columns, rows = (path.with_suffix(suffix).read_text(encoding="utf-8").split() for suffix in (".col", ".row"))
    assert (len(columns), len(rows)) == (len(found.x), len(found.g))
    return found, columns, rows


def droplets(problem: HorizonProblem, plan: IntPlan) -> dict[str, float]:
    """Every droplet by its name, whether it falls or not."""
    cells = np.ndindex(*plan.shape)
    return {
        f"u_{layer + 1}_{kind}_{i}_{j}": float(plan[layer, i, j] == kind)
        for layer, i, j in cells
        for kind in range(1, 1 + len(problem.kinds))
    }


def values_of(problem: HorizonProblem, plan: IntPlan) -> dict[str, float]:
    """Every variable by its name, calculated by the layer model of the core and by NumPy."""
    numbers, values = numbers_of(problem), droplets(problem, plan)
    reference = float(problem.height[problem.part].mean())
    H, step, before = problem.height, 0, problem.height
    for layer, pattern in enumerate(plan):
        for colour in problem.colours[layer] if problem.colours else (None,):
            i, j = np.indices(pattern.shape)
            own = pattern if colour is None else np.where(2 * (i % 2) + j % 2 == colour, pattern, 0)
            before, last = H, own.astype(np.int32)
            H = bindings.layer(H, last, problem.kinds)
            step += 1
            values |= {f"h_{step}_{i}_{j}": float(H[i, j] - reference) * UM_PER_M for i, j in np.ndindex(*H.shape)}
    lacking = np.asarray(numbers.target) - (H - reference) * UM_PER_M
    chance = chance_of(problem, before, last)
    upward, skew = (problem.overshoot + 1) / 2, (problem.overshoot - 1) / 2
    for i, j in np.ndindex(*H.shape):
        values |= {f"below_{i}_{j}": max(lacking[i, j], 0.0), f"above_{i}_{j}": max(-lacking[i, j], 0.0)}
        values[f"chance_{i}_{j}"] = chance[i, j]
        if problem.droplet_std > 0.0:
            values[f"cost_{i}_{j}"] = float(upward * expected_size(lacking[i, j], chance[i, j]) - skew * lacking[i, j])
        if problem.ceiling is not None:
            values[f"over_{i}_{j}"] = max(H[i, j] - problem.ceiling[i, j], 0.0) * UM_PER_M
    cells = (H[problem.part] - reference) * UM_PER_M
    deviation = np.sqrt(cells.var() + np.mean(chance[problem.part] ** 2) / 3.0)
    return {**values, "mean": float(cells.mean()), "deviation": float(deviation)}


def chance_of(problem: HorizonProblem, before: Any, pattern: Any) -> Any:
    """Uncertainty of the last droplets [um], each from the layer model with that droplet alone."""
    share = np.sqrt(3.0) * problem.droplet_std * UM_PER_M
    chance = np.full(pattern.shape, share * min(kind.h1 for kind in problem.kinds))
    for cell in zip(*np.nonzero(pattern), strict=True):
        alone = np.zeros_like(pattern)
        alone[cell] = pattern[cell]
        kept = bindings.layer(before, alone, problem.kinds)[cell] - before[cell]
        chance[cell] = max(chance[cell], share * kept)
    return chance


def read_at(found: Any, columns: list[str], values: Mapping[str, float]) -> tuple[float, Any, Any]:
    """Objective and rows of a .nl file, and the point."""
    x = ca.vertcat(*found.x)
    function = ca.Function("read", [x], [found.f, ca.vertcat(*found.g)])
    point = [values[name] for name in columns]
    objective, rows = function(point)
    return float(objective), np.asarray(rows).ravel(), np.array(point)


@pytest.mark.parametrize(("layers", "passes"), [(1, 1), (2, 1), (3, 1), (1, 4), (2, 4)])
def test_nl_file_has_the_objective_of_the_search_core(layers: int, passes: int, tmp_path: Path) -> None:
    """The point of a plan keeps all rows, and its objective is that of the plan."""
    for seed, droplet_std in ((0, 0.0), (1, 0.0), (0, 0.05), (1, 0.15)):
        problem = with_everything((4, 5), layers, passes, seed, droplet_std=droplet_std)
        problem.write(tmp_path / "layer.nl")
        found, columns, _ = read_nl(tmp_path / "layer.nl")
        for number in range(3):
            plan = random_plan(problem, number)
            values = values_of(problem, plan)
            objective, rows, point = read_at(found, columns, values)
            assert objective == pytest.approx(bindings.objective(problem, plan).value * UM_PER_M, rel=1e-9, abs=0.0)
            assert (rows >= np.array(found.g_lb) - SLACK_UM).all()
            assert (rows <= np.array(found.g_ub) + SLACK_UM).all()
            assert (point >= np.array(found.x_lb)).all()
            assert (point <= np.array(found.x_ub)).all()


def test_no_row_of_a_nl_file_is_idle(tmp_path: Path) -> None:
    """Any variable that is not a droplet is held by some row, in the direction that would lower the objective."""
    problem = with_everything((3, 4), 2, 1, 1, droplet_std=0.15)
    problem.write(tmp_path / "layer.nl")
    found, columns, _ = read_nl(tmp_path / "layer.nl")
    values = values_of(problem, random_plan(problem, 1))
    for name in columns:
        if name.startswith("u_"):
            continue
        _, rows, point = read_at(found, columns, {**values, name: values[name] - 1e-3})
        is_kept = (rows >= np.array(found.g_lb) - SLACK_UM).all() and (rows <= np.array(found.g_ub) + SLACK_UM).all()
        assert not is_kept or point[columns.index(name)] < np.array(found.x_lb)[columns.index(name)], name


def test_no_cell_gets_two_kinds_in_a_layer(tmp_path: Path) -> None:
    problem = with_everything((4, 5), 2, 1, 1)
    problem.write(tmp_path / "layer.nl")
    found, columns, rows = read_nl(tmp_path / "layer.nl")
    everywhere = {name: float(name.startswith("u_")) for name in columns}
    _, values, _ = read_at(found, columns, everywhere)
    broken = {name for name, value, most in zip(rows, values, found.g_ub, strict=True) if value > most + 0.5}
    choices = {f"one_{layer + 1}_{i}_{j}" for layer, i, j in np.argwhere(problem.choices == 3)}
    assert choices
    assert {name for name in broken if name.startswith("one_")} == choices


@pytest.mark.parametrize("seed", range(3))
def test_highs_finds_the_same_optimum_in_both_files(seed: int, tmp_path: Path) -> None:
    """By way of HiGHS's own reader and of CasADi's, against our own statement, and the objective of the plan found."""
    for problem in (rough((5, 4), seed=seed, overshoot=1.5), with_everything((5, 4), 1, 1, seed, alpha=1.0)):
        for name in ("layer.mps", "layer.nl"):
            problem.write(tmp_path / name)
        model = read_mps(tmp_path / "layer.mps")
        model.setOptionValue("mip_rel_gap", 0.0)
        model.run()
        best = model.getObjectiveValue()
        point = dict(zip(model.getLp().col_names_, model.getSolution().col_value, strict=True))
        plan = np.zeros(problem.choices.shape, np.int32)
        for droplet, value in point.items():
            if droplet.startswith("u_") and round(value):
                layer, kind, i, j = (int(part) for part in droplet[2:].split("_"))
                plan[layer - 1, i, j] = kind
        assert bindings.objective(problem, plan).value * UM_PER_M == pytest.approx(best, rel=1e-6, abs=1e-9)
        found, columns, _ = read_nl(tmp_path / "layer.nl")
        is_whole = [column.startswith("u_") for column in columns]
        solver = ca.qpsol(
            "solver",
            "highs",
            {"x": ca.vertcat(*found.x), "f": found.f, "g": ca.vertcat(*found.g)},
            {"discrete": is_whole, "highs": {"output_flag": False, "mip_rel_gap": 0.0}, "print_time": False},
        )
        other = solver(lbx=found.x_lb, ubx=found.x_ub, lbg=found.g_lb, ubg=found.g_ub)
        assert float(other["f"]) == pytest.approx(best, rel=1e-6, abs=1e-9)


def test_optimum_of_a_mps_file_is_that_of_our_own_program(tmp_path: Path) -> None:
    problem = nearly_flat((5, 5), seed=1)
    problem.write(str(tmp_path / "layer.mps"))
    model = read_mps(tmp_path / "layer.mps")
    model.run()
    bounds = [line.split() for line in (tmp_path / "layer.mps").read_text(encoding="utf-8").splitlines()]
    uppers = {line[2]: line[3] for line in bounds if line[0] == "UP"}
    assert uppers == {f"u_1_1_{i}_{j}": "1.0" for i, j in np.ndindex(5, 5)}
    own = HorizonProgram(problem, "highs", whole=True).solve(problem)
    assert own.value * UM_PER_M == pytest.approx(model.getObjectiveValue(), rel=2e-4, abs=0.0)


def jacobian_lines(lines: list[str]) -> list[str]:
    """The entries of all J segments."""
    heads = [(k, int(line.split()[1])) for k, line in enumerate(lines) if line.startswith("J")]
    return [line for k, count in heads for line in lines[k + 1 : k + 1 + count]]


def test_header_of_a_nl_file_and_ends_of_columns_count_what_the_file_holds(tmp_path: Path) -> None:
    """CasADi's reader needs two of the counts; others take memory by all."""
    problem = with_everything((3, 4), 2, 1, 1)
    problem.write(tmp_path / "layer.nl")
    lines = (tmp_path / "layer.nl").read_text(encoding="utf-8").splitlines()
    _, columns, rows = read_nl(tmp_path / "layer.nl")
    counts = [[int(count) for count in line.split()] for line in lines[1:10]]
    whole = [column.startswith("u_") for column in columns]
    bent_rows = sum(lines[k + 1] != "n0" for k, line in enumerate(lines) if line.startswith("C"))
    bent = {int(line[1:]) for line in lines if line.startswith("v")}
    sides = lines[lines.index("r") : lines.index("b")]
    jacobian = sum(int(line.split()[1]) for line in lines if line.startswith("J"))
    ends = lines[lines.index(f"k{len(columns) - 1}") + 1 :][: len(columns) - 1]
    entries = [int(line.split()[0]) for line in jacobian_lines(lines)]
    assert [int(end) for end in ends] == [sum(column <= k for column in entries) for k in range(len(columns) - 1)]
    assert counts[0] == [len(columns), len(rows), 1, 0, sum(line.startswith("4 ") for line in sides)]
    assert counts[1] == [bent_rows, 0]
    assert counts[3] == [len(bent), 0, 0]
    assert bent == set(range(len(bent)))
    assert counts[5] == [sum(whole[len(bent) :]), 0, 0, sum(whole[: len(bent)]), 0]
    assert whole[: len(bent)] == sorted(whole[: len(bent)])
    assert whole[len(bent) :] == sorted(whole[len(bent) :])
    objective = [int(line.split()[1]) for line in lines if line.startswith("G0")]
    assert counts[6] == [jacobian, *objective]
    assert counts[7] == [max(map(len, rows)), max(map(len, columns))]


@pytest.mark.parametrize(
    ("values", "found"),
    [
        ({"alpha": 0.8}, r"alpha = 0\.8"),
        ({"droplet_std": 0.1}, r"droplet_std = 0\.1"),
        ({"colours": ((0, 3, 1, 2),)}, "4 passes"),
        ({"choices": np.ones((2, 3, 3), np.uint16)}, "2 layers"),
    ],
)
def test_mps_is_refused_for_what_is_not_linear(values: dict[str, Any], found: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=rf"layer\.mps: a problem with {found} is not linear.*write a \.nl file"):
        rough((3, 3), **values).write(tmp_path / "layer.mps")
    assert not list(tmp_path.iterdir())


def test_other_endings_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"ends in '\.lp'; needs \.mps .* or \.nl"):
        rough((3, 3)).write(tmp_path / "layer.lp")
