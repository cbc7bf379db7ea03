"""A rule for patterns controls the print behind the handshake of the layer contract."""

from __future__ import annotations

import sys
import types
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from inkloop.component import FloatMap, Ink, Job, Status
from inkloop.components import catalog
from inkloop.course.layer_course import LayerCourse, contract_connections
from inkloop.errors import ComponentError, ScenarioError
from inkloop.master.master import Master
from inkloop.testing import RESUMABLE_CONTRACT_CHECKS, ContractCheck, job
from inkloop_controller.baseline_planners import CohenLipson, ErrorDiffusion, OpenLoop, StochasticGreedy
from inkloop_controller.controllers import CohenLipsonController, ErrorDiffusionController, OpenLoopController
from inkloop_controller.core.bindings import paper_search
from inkloop_controller.estimation.estimate_figures import EstimateFigures
from inkloop_controller.estimation.height_estimator import Estimate
from inkloop_controller.model import LayerModel, ink_maps
from inkloop_controller.planning.layer_plan import PlanStatus
from inkloop_controller.problem.horizon_problem import full_layers
from support.closed_loop import block, cylinder, print_part
from support.half_spaces import Above
from support.long_proofs import rest_is_long
from support.toys import DROPLET, ToyPrinter, ToyProfiler, toy_job

SECOND = 1_000_000_000


class Missing:
    """Jets wherever more than `least_m` are missing."""

    def __init__(self, job: Job, *, least_m: float = DROPLET / 2) -> None:
        self.job, self.least_m = job, least_m

    def pattern(self, height: FloatMap, layer: int) -> ArrayLike:
        return self.job.target_height - height > self.least_m


@pytest.fixture(autouse=True)
def workshop(monkeypatch: pytest.MonkeyPatch) -> types.ModuleType:
    module = types.ModuleType("workshop")
    module.Missing = Missing  # type: ignore[attr-defined]
    module.Nothing = type("Nothing", (), {"__init__": lambda self, job: None})  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "workshop", module)
    return module


@pytest.mark.parametrize("check", RESUMABLE_CONTRACT_CHECKS)
def test_controller_of_a_rule_keeps(check: ContractCheck) -> None:
    check(lambda: catalog.make("workshop:Missing", job(), {"least_m": 3e-6}))


def test_rule_prints_until_it_wants_nothing() -> None:
    wanted = toy_job(layers=3)
    parts = {
        "controller": catalog.make("workshop:Missing", wanted, {}),
        "printer": ToyPrinter(wanted),
        "profiler": ToyProfiler(wanted),
    }
    master = Master(parts, contract_connections(parts), step_ns=SECOND, course=LayerCourse(parts, layers_max=10))
    assert master.run() == "done"
    outputs = parts["printer"].do_step(0, SECOND, {"layer_command": np.asarray(3), "pattern": np.zeros((4, 3))})
    np.testing.assert_allclose(outputs["height"], wanted.target_height)
    assert int(outputs["layers_printed"]) == 3


@pytest.mark.parametrize(
    ("pattern", "message"),
    [
        (np.ones((3, 3), int), r"the pattern for layer 1 has shape \(3, 3\); needs \(4, 3\)"),
        (np.full((4, 3), 0.5), "the pattern for layer 1 is float64; needs whole numbers or booleans"),
        (np.full((4, 3), "x"), "the pattern for layer 1 is <U1; needs whole numbers or booleans"),
        (np.full((4, 3), 2), r"the pattern for layer 1 is 2 in cell \(0, 0\); needs 0 .. 1, the number of inks"),
        (-np.eye(4, 3, -1, int), r"the pattern for layer 1 is -1 in cell \(1, 0\); needs 0 .. 1"),
    ],
)
def test_what_is_no_pattern_is_refused(
    workshop: types.ModuleType, pattern: ArrayLike, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Missing, "pattern", lambda self, height, layer: pattern)
    part = catalog.make("workshop:Missing", toy_job(), {})
    inputs = {port.name: port.start_value() for port in part.inputs}
    assert int(part.initialize(0, inputs)["status"]) == Status.IDLE
    with pytest.raises(ComponentError, match=message):
        part.do_step(0, SECOND, {**inputs, "layers_scanned": np.asarray(0), "valid": np.ones((4, 3), bool)})


@pytest.mark.parametrize("dtype", [np.bool_, np.uint8, np.int64])
def test_rule_may_change_the_surface_that_it_is_given(dtype: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """And its pattern may be of any whole numbers."""

    def spoiled(self: Missing, height: FloatMap, layer: int) -> ArrayLike:
        height[:] = 1.0
        return np.ones((4, 3), dtype)

    monkeypatch.setattr(Missing, "pattern", spoiled)
    part = catalog.make("workshop:Missing", toy_job(), {})
    inputs = {port.name: port.start_value() for port in part.inputs}
    part.initialize(0, inputs)
    found = part.do_step(0, SECOND, {**inputs, "layers_scanned": np.asarray(0), "valid": np.ones((4, 3), bool)})
    assert not found["estimated_height"].any()
    np.testing.assert_array_equal(found["pattern"], np.ones((4, 3)))


def test_class_that_is_neither_component_nor_rule_is_refused_with_what_it_lacks() -> None:
    with pytest.raises(ScenarioError, match="workshop:Nothing', which has no inputs, outputs, initialize, do_step"):
        catalog.make("workshop:Nothing", toy_job(), {})


INK = Ink()


def rough(job: Job, seed: int) -> Any:
    """A surface below and above the target by up to a layer."""
    return job.target_height + np.random.default_rng(seed).uniform(-8e-6, 4e-6, job.target_height.shape)


def footprint(job: Job, i: int, j: int) -> Any:
    """Heights that a droplet adds to the part on flat ground."""
    added = np.zeros((job.nx, job.ny))
    for di, dj in np.ndindex(3, 3):
        added[i + di - 1, j + dj - 1] = (INK.h1, INK.h2, INK.h3)[abs(di - 1) + abs(dj - 1)]
    return np.where(job.mask, added, 0.0)


def dropped(job: Job, height: Any) -> Any:
    return CohenLipson(job).droplets(height, ink_maps((INK,), np.zeros((job.nx, job.ny), np.int32)))


@pytest.mark.parametrize("shape", [(14, 12), (60, 5)])
@pytest.mark.parametrize("seed", range(5))
def test_sweeps_drop_what_the_choice_one_by_one_drops(seed: int, shape: tuple[int, int]) -> None:
    """Also on a part that is a line of cells, of which every droplet loses much beside it."""
    job = block(*shape)
    height = rough(job, seed)
    prints = {(int(i), int(j)): footprint(job, i, j) for i, j in np.argwhere(job.mask)}
    lacking, one_by_one = np.where(job.mask, job.target_height - height, 0.0), np.zeros_like(job.mask)
    while prints:
        excess = {cell: (lacking * print_).sum() - (print_**2).sum() / 2 for cell, print_ in prints.items()}
        weighted = {cell: (lacking * print_).sum() / print_.sum() for cell, print_ in prints.items()}
        able = [cell for cell in prints if excess[cell] > 0.0]
        if not able:
            break
        cell = max(able, key=lambda cell: weighted[cell])
        one_by_one[cell] = True
        lacking = lacking - prints.pop(cell)
    assert one_by_one.sum() > 9
    np.testing.assert_array_equal(dropped(job, height), one_by_one)


@pytest.mark.parametrize("seed", range(5))
def test_no_further_droplet_would_lower_the_squares_of_the_predicted_map(seed: int) -> None:
    job = block(14, 12)
    height = rough(job, seed)
    chosen = dropped(job, height)
    grown = sum(footprint(job, i, j) for i, j in np.argwhere(chosen))
    lacking = np.where(job.mask, job.target_height - height - grown, 0.0)
    for i, j in np.argwhere(job.mask & ~chosen):
        assert ((lacking - footprint(job, i, j)) ** 2).sum() >= (lacking**2).sum() * (1.0 - 1e-12)


def test_density_of_error_diffusion_is_the_share_of_a_layer_that_is_lacking() -> None:
    job = block(44, 44)
    for share in (0.1, 0.35, 0.8):
        estimate = Estimate.exact(job.target_height - share * INK.layer_height, job.inks)
        pattern = ErrorDiffusion(job).plan(estimate, 0, np.zeros((1, 44, 44), np.int32)).pattern
        assert pattern[job.mask].mean() == pytest.approx(share, abs=0.01)
        assert not pattern[~job.mask].any()


@pytest.mark.parametrize("make", [CohenLipson, ErrorDiffusion, lambda job: CohenLipson(job, threshold=0.0)])
def test_nothing_falls_where_nothing_is_lacking(make: Any) -> None:
    job = block()
    plan = make(job).plan(Estimate.exact(job.target_height, job.inks), 3, np.zeros((1, job.nx, job.ny), np.int32))
    assert plan.status is PlanStatus.DONE
    assert not plan.pattern.any()


@pytest.mark.parametrize("make", [OpenLoop, CohenLipson, ErrorDiffusion])
def test_surface_is_predicted_with_the_passes_of_the_layer_that_is_due(make: Any) -> None:
    job = block(passes=4, pass_order=2, pass_rotation=1)
    estimate = Estimate.exact(rough(job, 2), job.inks)
    plan = make(job).plan(estimate, 2, np.zeros((1, job.nx, job.ny), np.int32))
    due, other = (LayerModel.of(job).layer(estimate.height, plan.pattern, number) for number in (3, 2))
    np.testing.assert_array_equal(plan.predicted_height, due)
    assert not np.array_equal(due, other)


HALF = (Ink(INK.h1 / 2, INK.h2 / 2, INK.h3 / 2),)
PLANNERS = [lambda job: OpenLoop(job, layers=9), CohenLipson, ErrorDiffusion, StochasticGreedy]


@pytest.mark.parametrize("make", PLANNERS)
def test_ink_of_the_estimate_stands_instead_of_that_of_the_job(make: Any) -> None:
    job, nothing = block(), np.zeros((1, 10, 9), np.int32)
    estimate = Estimate.exact(job.target_height - 3e-6, HALF)
    found, expected = (make(each).plan(estimate, 1, nothing) for each in (job, replace(job, inks=HALF)))
    assert found.pattern.any()
    np.testing.assert_array_equal(found.pattern, expected.pattern)
    np.testing.assert_array_equal(found.predicted_height, expected.predicted_height)
    after = LayerModel(HALF).layer(estimate.height, found.pattern)
    np.testing.assert_array_equal(found.predicted_height, after)


@pytest.mark.parametrize("make", PLANNERS[:3])
def test_worth_of_a_pattern_is_the_mean_error_that_it_leaves(make: Any) -> None:
    job = block()
    plan = make(job).plan(Estimate.exact(rough(job, 3), job.inks), 0, np.zeros((1, 10, 9), np.int32))
    error = np.abs(plan.predicted_height - job.target_height)[job.mask].mean()
    assert plan.objective.value == plan.objective.error == pytest.approx(error, rel=1e-12, abs=0.0)
    assert plan.status is PlanStatus.FIXED


@pytest.mark.parametrize("make", [CohenLipson, ErrorDiffusion])
def test_ground_beside_the_part_changes_no_droplet(make: Any) -> None:
    job = block(14, 12)
    height, nothing = rough(job, 4), np.zeros((1, 14, 12), np.int32)
    high = np.where(job.mask, height, 20e-6)
    found, expected = (make(job).plan(Estimate.exact(each, job.inks), 0, nothing).pattern for each in (high, height))
    assert expected.any()
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize(("lacking_um", "droplets"), [(3.07, 2), (3.02, 1)])
def test_what_spills_beside_the_part_keeps_no_droplet_away(lacking_um: float, droplets: int) -> None:
    """The first of two cells' droplets leaves on the part a weighted (4.4 (x - 0.6) + 0.6 (x - 4.4)) / 5.0 of x for the
    other one, which adds twice (4.4^2 + 0.6^2) / 10.0 = 1.972 um, weighted."""
    job = block(6, 5)
    assert dropped(job, job.target_height - lacking_um * 1e-6).sum() == droplets


@pytest.mark.parametrize(
    ("make", "ink"),
    [
        (lambda job: OpenLoop(job), 1),
        (lambda job: StochasticGreedy(job), 2),
        (lambda job: CohenLipson(job), 1),
        (lambda job: CohenLipson(job, region_test="surface"), 2),
        (lambda job: ErrorDiffusion(job), 1),
        (lambda job: ErrorDiffusion(job, region_test="surface"), 2),
    ],
)
def test_region_is_asked_in_the_middle_of_the_layer_or_on_the_surface(make: Any, ink: int) -> None:
    """The surface lies below the region, and half a layer above it, 3.6 um, is in it."""
    job = block(inks=(INK, Ink(3.9e-6, 0.55e-6, 0.15e-6)), region=Above(3e-6))
    plan = make(job).plan(Estimate.exact(np.zeros((10, 9)), job.inks), 0, np.zeros((1, 10, 9), np.int32))
    assert set(plan.pattern[job.mask]) == {ink}


def test_work_of_the_papers_search_is_limited_and_says_so() -> None:
    job = block()
    estimate, nothing = Estimate.exact(rough(job, 5) - 6e-6, job.inks), np.zeros((1, 10, 9), np.int32)
    cut = StochasticGreedy(job, batch=1, iterations_max=1).plan(estimate, 0, nothing)
    whole = StochasticGreedy(job).plan(estimate, 0, nothing)
    assert (cut.status, cut.sweeps, whole.status) == (PlanStatus.BUDGET, 1, PlanStatus.REPAIRED)
    assert job.mask.sum() - cut.pattern.sum() <= 1


def test_papers_search_goes_by_the_predicted_surface_alone() -> None:
    """Whatever is learnt of the droplets; as many layers ahead as were asked for."""
    job = block()
    estimate = replace(Estimate.exact(rough(job, 5), job.inks), figures=EstimateFigures(droplet_std=0.3))
    for horizon, options in ((1, {}), (2, {"horizon": 2})):
        problem = StochasticGreedy(job, **options)._problems.problem(estimate, 0)
        assert (problem.layers, problem.droplet_std, problem.overshoot) == (horizon, 0.0, 1.0)


def test_first_layer_with_a_droplet_of_the_papers_plan_is_printed() -> None:
    """The one droplet that a cell lacks may be left in either of two layers."""
    job = block(5, 5, height=INK.h1)
    planner, estimate = StochasticGreedy(job, horizon=2), Estimate.exact(np.zeros((5, 5)), job.inks)
    for layer in range(8):
        assert planner.plan(estimate, layer, np.zeros((1, 5, 5), np.int32)).pattern[2, 2] == 1


@pytest.mark.system
@pytest.mark.parametrize("make", rest_is_long([ErrorDiffusionController, CohenLipsonController], 1))
def test_cylinder_ends_flatter_and_nearer_to_its_height_than_in_open_loop(make: Any) -> None:
    job = cylinder()
    blind = print_part(OpenLoopController(job), job, variation=0.2, seed=1).errors_um(job)
    bias, mae, std = print_part(make(job), job, variation=0.2, seed=1).errors_um(job)
    assert abs(bias) < 0.2
    assert mae < blind[1] / 20
    assert std < blind[2] / 3


def test_higher_threshold_leaves_the_surface_lower() -> None:
    job = block(14, 12)
    surfaces = [
        print_part(CohenLipsonController(job, threshold_um=threshold), job, variation=0.2, seed=3)
        for threshold in (0.0, 1.5, 3.0)
    ]
    errors = [one.errors_um(job)[0] for one in surfaces]
    assert errors[0] < errors[1] < errors[2]


def test_seed_and_layer_have_halves_of_the_random_key_of_the_papers_search() -> None:
    job = replace(block(34, 32), seed=2**32 + 3)
    planner, estimate = StochasticGreedy(job), Estimate.exact(rough(job, 1), job.inks)
    problem = planner._problems.problem(estimate, 7)
    found = paper_search(problem, full_layers(problem), 20, 100_000, 3 * 2**32 + 7)
    np.testing.assert_array_equal(planner.plan(estimate, 7, found.plan).plan, found.plan)
    other = paper_search(problem, full_layers(problem), 20, 100_000, 3 * 2**32 + 8)
    assert not np.array_equal(other.plan, found.plan)


def test_threshold_below_zero_is_refused() -> None:
    with pytest.raises(ValueError, match="threshold is -1e-06; needs a height of at least 0"):
        CohenLipsonController(block(), threshold_um=-1.0)
