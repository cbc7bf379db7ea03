"""The prediction model: C core, CasADi and NumPy are the same map."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from inkloop.component import Ink, Job
from inkloop_controller.baseline_planners import nominal_layer_height
from inkloop_controller.core.bindings import split
from inkloop_controller.estimation.height_estimator import Estimate
from inkloop_controller.model import DropletChoices, LayerModel
from inkloop_controller.planning.layer_mpc import LayerMpc
from inkloop_controller.problem.horizon_problem import HorizonProblem, even_droplets, full_layers, no_droplets
from support.closed_loop import block
from support.half_spaces import Below
from support.ink_choices import ink_choices
from support.numpy import lu_numpy

INKS = (Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6))
GRIDS = [(1, 1), (1, 7), (7, 1), (2, 2), (5, 8), (20, 20)]


def case(shape: tuple[int, int]) -> tuple[Any, Any, Any]:
    rng = np.random.default_rng(shape[0] * 100 + shape[1])
    return rng.uniform(0.0, 12e-6, shape), rng.integers(0, 3, shape, dtype=np.int32), rng.uniform(0.5, 1.0, shape)


def reference(height: Any, pattern: Any, **options: Any) -> Any:
    inks = tuple((ink.h1, ink.h2, ink.h3) for ink in INKS)
    return lu_numpy.layer(height, pattern, inks, **options)[0]


@pytest.mark.parametrize("shape", GRIDS)
def test_core_is_the_layer_map(shape: tuple[int, int]) -> None:
    height, pattern, factor = case(shape)
    expected = reference(height, pattern, factor=factor)
    np.testing.assert_allclose(LayerModel(INKS).layer(height, pattern, factor=factor), expected, rtol=1e-12, atol=0)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("rotation", [0, 1, 3])
def test_four_passes_act_one_on_the_other(order: int, rotation: int) -> None:
    height, pattern, _ = case((5, 8))
    model = LayerModel(INKS, 4, order, rotation)
    for number in (1, 2, 5):
        expected = reference(height, pattern, passes=4, order=order, rotation=rotation, number=number)
        np.testing.assert_allclose(model.layer(height, pattern, number), expected, rtol=1e-12, atol=0)
    assert np.abs(model.layer(height, pattern) - LayerModel(INKS).layer(height, pattern)).max() > 0.1e-6


@pytest.mark.parametrize("shape", GRIDS)
def test_symbolic_map_is_the_layer_map(shape: tuple[int, int]) -> None:
    height, pattern, _ = case(shape)
    material = np.maximum(pattern - 1, 0)
    H, U = ca.MX.sym("H", *shape), ca.MX.sym("U", *shape)
    symbolic = ca.Function("layer", [H, U], [LayerModel(INKS).symbolic(H, U, material)])
    found = np.asarray(symbolic(height, (pattern > 0).astype(float)))
    np.testing.assert_allclose(found, reference(height, pattern), rtol=1e-12, atol=0)


def test_symbolic_map_is_of_the_first_ink_without_materials_and_for_one_pass_alone() -> None:
    height, pattern, _ = case((5, 8))
    H, U = ca.MX.sym("H", 5, 8), ca.MX.sym("U", 5, 8)
    symbolic = ca.Function("layer", [H, U], [LayerModel(INKS).symbolic(H, U)])
    found = np.asarray(symbolic(height, (pattern > 0).astype(float)))
    np.testing.assert_allclose(found, reference(height, np.minimum(pattern, 1)), rtol=1e-12, atol=0)
    with pytest.raises(ValueError, match="passes is 4; the symbolic map is written for one pass"):
        LayerModel(INKS, passes=4).symbolic(H, U)


def test_scale_of_the_ink_scales_every_droplet() -> None:
    height, pattern, _ = case((5, 8))
    scaled = LayerModel(INKS).scaled(0.9).layer(height, pattern)
    expected = LayerModel(INKS).layer(height, pattern, factor=np.full((5, 8), 0.9))
    np.testing.assert_allclose(scaled, expected, rtol=1e-12)


@pytest.mark.parametrize(("passes", "order"), [(2, 1), (4, 3)])
def test_passes_that_there_are_not_are_refused(passes: int, order: int) -> None:
    with pytest.raises(ValueError, match="needs 1 or 4 passes in order 1"):
        LayerModel(INKS, passes, order)


def test_pattern_beyond_the_inks_is_refused() -> None:
    with pytest.raises(ValueError, match="needs 0 to 1, the inks given"):
        LayerModel((Ink(),)).layer(np.zeros((2, 2)), np.full((2, 2), 2, np.int32))


def problem(choices: Any) -> HorizonProblem:
    """A flat surface of 2 x 2 cells; choices: bits per layer, everywhere the same, or a whole map."""
    maps = np.broadcast_to(np.array(choices, np.uint16).reshape(len(choices), -1, 1), (len(choices), 2, 2)).copy()
    return HorizonProblem(np.zeros((2, 2)), np.full((2, 2), 1e-5), np.ones((2, 2), np.bool_), maps, INKS, 0.8)


def test_full_layers_take_the_first_kind_that_may_fall() -> None:
    plan = full_layers(problem([0, 1, 2, 3]))
    assert plan[:, 0, 0].tolist() == [0, 1, 2, 1]
    assert not no_droplets(problem([3, 3])).any()


def test_even_droplets_are_equal_shares_of_what_lacks_where_droplets_may_fall() -> None:
    of = problem([1, 0, 3, 1])
    of.height[:] = [[0.0, 4e-6], [12e-6, -1.0]]
    shares = np.array([[10 / 4 / 7.6, 6 / 4 / 7.6], [0.0, 1.0]])
    np.testing.assert_allclose(even_droplets(of), shares * np.array([1, 0, 1, 1])[:, None, None], rtol=1e-12)


def two_inks(boundary: float) -> Any:
    return block(6, 6, inks=INKS, region=Below(boundary))


def problem_of_bare_ground(job: Job, horizon: int, inks: Any = INKS[:1], **options: Any) -> HorizonProblem:
    """The problem of the layers on bare ground."""
    mpc = LayerMpc(job, horizon=horizon, choices=DropletChoices(job, **options))
    return mpc.problem(Estimate.exact(np.zeros((job.nx, job.ny)), inks), 0)


def test_one_ink_may_fall_on_the_part_alone() -> None:
    job = block(7, 8)
    allowed = problem_of_bare_ground(job, 3).choices
    assert allowed.dtype == np.uint16
    assert (allowed == job.mask).all()


@pytest.mark.parametrize(("test", "expected"), [("surface", [1, 1, 2]), ("middle", [1, 2, 2]), ("either", [1, 3, 2])])
def test_regions_of_later_layers_lie_a_nominal_layer_higher_each(test: Any, expected: list[int]) -> None:
    job = two_inks(0.0)
    step = nominal_layer_height(job)
    job = two_inks(1.4 * step)
    assert ink_choices(job, test, np.zeros((6, 6)), 3)[:, 3, 3].tolist() == expected


def test_ends_of_the_layer_are_asked_about_where_either_ink_is_right() -> None:
    step = nominal_layer_height(two_inks(0.0))
    for boundary in (0.1, 0.5, 0.9):
        assert (ink_choices(two_inks(boundary * step), "either", np.zeros((6, 6)), 1) == 3).all()


def test_grey_kinds_are_multiples_of_the_inks() -> None:
    found = problem_of_bare_ground(two_inks(1.0), 1, INKS, drop_levels=3)
    kinds = found.kinds
    assert len(kinds) == 6
    assert kinds[5] == Ink(3 * INKS[1].h1, 3 * INKS[1].h2, 3 * INKS[1].h3)
    assert found.choices[0, 3, 3] == 0b010101  # ink A in all its sizes
    pattern, level = split(np.array([[0, 1, 2, 5, 6]], np.int32), 2)
    assert pattern.tolist() == [[0, 1, 2, 1, 2]]
    assert level.tolist() == [[1, 1, 1, 3, 3]]


@pytest.mark.parametrize(("nozzle", "pitch", "columns"), [(1, 4, [1, 5]), (6, 0, [6]), (0, 3, [0, 3, 6])])
def test_dead_nozzles_jet_nothing_in_any_layer(nozzle: int, pitch: int, columns: list[int]) -> None:
    """Without a pitch there is a nozzle for each column."""
    job = block(6, 9)
    allowed = problem_of_bare_ground(job, 2, dead_nozzles=(nozzle,), nozzle_pitch=pitch).choices
    dead = np.isin(np.arange(9), columns)
    assert not allowed[:, :, dead].any()
    assert (allowed[:, :, ~dead] == job.mask[:, ~dead]).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"drop_levels": 0}, "drop_levels is 0 with 1 inks"),
        ({"drop_levels": 17}, "needs 1 to 16"),
        ({"nozzle_pitch": -1}, "nozzle_pitch is -1"),
        ({"dead_nozzles": (4,), "nozzle_pitch": 4}, "dead_nozzles has 4; needs nozzles 0 to 3"),
        ({"dead_nozzles": (8, -1)}, "^dead_nozzles has -1; needs nozzles 0 to 8$"),
    ],
)
def test_what_no_head_has_is_refused(options: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        DropletChoices(block(), **options)


@pytest.mark.parametrize(("inks", "most"), [(1, 16), (2, 8)])
def test_sizes_of_all_inks_together_are_sixteen_kinds_at_most(inks: int, most: int) -> None:
    job = block(inks=INKS[:inks])
    assert len(problem_of_bare_ground(job, 1, INKS[:inks], drop_levels=most).kinds) == 16
    with pytest.raises(ValueError, match=f"^drop_levels is {most + 1} with {inks} inks; needs 1 to {most}$"):
        DropletChoices(job, drop_levels=most + 1)


def test_nominal_layer_is_of_the_first_ink_and_where_there_is_a_region_the_mean_over_the_inks() -> None:
    assert nominal_layer_height(two_inks(1.0)) == pytest.approx(7.15e-6, rel=1e-12, abs=0.0)
    assert nominal_layer_height(block(inks=INKS)) == pytest.approx(7.6e-6, rel=1e-12, abs=0.0)
