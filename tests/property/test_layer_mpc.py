"""Invariants of the planner on any small job."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from inkloop.component import BoolMap, FloatMap, HeightIntervals, Ink, Job
from inkloop.geometry import contained
from inkloop_controller.core import bindings
from inkloop_controller.core.bindings import diffuse
from inkloop_controller.estimation.height_estimator import Estimate
from inkloop_controller.model import DropletChoices, LayerModel
from inkloop_controller.planning.layer_mpc import LayerMpc
from inkloop_controller.planning.layer_plan import LayerPlan, PlanStatus
from inkloop_controller.problem.criterion import DEFAULT_WORK, Criterion, Work
from inkloop_controller.problem.horizon_problem import IntPlan, full_layers, no_droplets
from support.examples import examples
from support.numpy.plan_starts_numpy import best_of, shifted
from support.problem_plans import best_plan

INKS = (Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6))
ROUNDING = 1e-13  # [m]


@dataclass(frozen=True)
class Wavy:
    """Below a plane that leans along x."""

    lean: float

    def contains(self, x: FloatMap, y: FloatMap, z: FloatMap) -> BoolMap:
        return contained(self.intervals(x, y), z)

    def intervals(self, x: FloatMap, y: FloatMap) -> HeightIntervals:
        return ((np.full_like(x, -np.inf), 4e-4 + self.lean * x + 0.0 * y),)


@dataclass(frozen=True)
class Case:
    """A job, how it is planned, and where the print stands."""

    job: Job
    criterion: Criterion
    options: dict[str, Any]
    horizon: int
    estimate: Estimate
    layer: int
    last: IntPlan
    annealing: int | None

    def mpc(self, threads: int = 1) -> LayerMpc:
        choices = DropletChoices(self.job, **self.options)
        return LayerMpc(
            self.job,
            criterion=self.criterion,
            horizon=self.horizon,
            choices=choices,
            work=Work(threads=threads, annealing_sweeps=self.annealing),
        )

    def planned(self, threads: int = 1) -> LayerPlan:
        return self.mpc(threads).plan(self.estimate, self.layer, self.last)


WORTHS = [0.0, 0.0015, 0.05]
ALPHAS: list[Any] = [0.0, 0.1, 0.8, 1.0, [(1, 0.3), (3, 0.9)]]


@st.composite
def cases(draw: st.DrawFn) -> Case:
    """Jobs of one ink or two, of one pass or four, with all that the planner can be configured with."""
    nx, ny = draw(st.integers(1, 8)), draw(st.integers(1, 8))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    mask = rng.random((nx, ny)) < draw(st.sampled_from([0.4, 0.9, 1.0]))
    mask.flat[0] = True
    ground, rough = draw(st.sampled_from([0.0, 4e-4])), draw(st.sampled_from([0.0, 1e-6, 2e-5]))
    height = ground + rng.uniform(0.0, rough, (nx, ny))
    target = np.where(mask, height.mean() + rng.uniform(-1e-5, 3e-5, (nx, ny)), 0.0)
    inks = INKS[: draw(st.integers(1, 2))]
    job = Job(
        nx,
        ny,
        263.256e-6,
        target,
        mask,
        inks=inks,
        region=Wavy(draw(st.sampled_from([-0.05, 0.0, 0.02]))) if len(inks) == 2 else None,
        passes=draw(st.sampled_from([1, 4])),
        pass_order=draw(st.integers(1, 2)),
        pass_rotation=draw(st.integers(0, 3)),
        seed=draw(st.integers(0, 9)),
    )
    pitch = draw(st.sampled_from([0, 3]))
    nozzles = st.lists(st.integers(0, (pitch or ny) - 1), max_size=2)
    options: dict[str, Any] = {
        "region_test": draw(st.sampled_from(["middle", "surface", "either"])),
        "drop_levels": draw(st.integers(1, 3)),
        "dead_nozzles": tuple(draw(nozzles)),
        "nozzle_pitch": pitch,
    }
    criterion = Criterion(
        alpha=draw(st.sampled_from(ALPHAS)),
        overshoot=draw(st.sampled_from([0.5, 1.0, 4.0])),
        overshoot_limit=draw(st.sampled_from([np.inf, 0.0, 5e-6])),
        chance_margin=draw(st.sampled_from([0.0, 2.0])),
        fringe_weight=draw(st.sampled_from([0.0, 0.3, 1.0])),
        layer_worth=draw(st.sampled_from(WORTHS)),
    )
    scale = draw(st.sampled_from([0.6, 1.0]))
    estimate = replace(
        Estimate.exact(height, LayerModel(inks).scaled(scale).inks),
        height_variance=rng.uniform(0.0, 1e-12, (nx, ny)),
        dead=rng.random((nx, ny)) < draw(st.sampled_from([0.0, 0.3, 1.0])),
    )
    shape = draw(st.sampled_from([(nx, ny), (nx + 1, ny)]))
    last = rng.integers(0, 1 + len(inks) * options["drop_levels"], (draw(st.integers(1, 5)), *shape), dtype=np.int32)
    annealing = draw(st.sampled_from([0, 1, 10, None]))  # None: up to 200 sweeps for plans as small as these
    return Case(job, criterion, options, draw(st.integers(1, 3)), estimate, draw(st.integers(0, 9)), last, annealing)


def same(one: LayerPlan, other: LayerPlan) -> bool:
    """Whether two plans agree in every bit, but for their times."""
    names = ({field.name for field in fields(LayerPlan)} - {"seconds", "predict"}) | {"predicted_height"}
    return all(np.array_equal(getattr(one, name), getattr(other, name), equal_nan=name == "bound") for name in names)


@given(cases())
@settings(max_examples=examples(300))
def test_plan_keeps_to_the_choices_and_begins_with_a_layer_unless_the_print_is_done(case: Case) -> None:
    plan, problem = case.planned(), case.mpc().problem(case.estimate, case.layer)
    assert ((2 * problem.choices.astype(np.int64) + 1) >> plan.plan & 1).all()
    assert plan.plan[0].any() == (plan.status is not PlanStatus.DONE)
    assert plan.plan.any() == plan.plan[0].any()
    np.testing.assert_array_equal(plan.pattern > 0, plan.plan[0] > 0)
    np.testing.assert_array_equal(plan.drop_level > 0, plan.plan[0] > 0)


@given(cases())
@settings(max_examples=examples(300))
def test_plan_is_never_worse_than_nothing_full_layers_or_the_rest_of_the_last_plan(case: Case) -> None:
    case = replace(case, criterion=replace(case.criterion, layer_worth=0.0))
    plan, problem = case.planned(), case.mpc().problem(case.estimate, case.layer)
    others = [no_droplets(problem)]
    others += [full for full in [full_layers(problem)] if full[0].any()]
    if case.last.shape[1:] == problem.height.shape:
        others += [rest for rest in [shifted(case.last, problem)] if rest[0].any()]
    for other in others:
        assert plan.objective.value <= bindings.objective(problem, other).value + ROUNDING


@given(cases())
@settings(max_examples=examples(300))
def test_layers_left_out_lose_less_and_layers_printed_gain_more_than_they_are_worth(case: Case) -> None:
    every = replace(case, criterion=replace(case.criterion, layer_worth=0.0)).planned()
    plan, problem = case.planned(), case.mpc().problem(case.estimate, case.layer)
    printed = int(np.count_nonzero(plan.plan.any((1, 2))))
    price = (case.criterion.layer_worth or 0.0) * problem.kinds[0].layer_height
    nothing = bindings.objective(problem, no_droplets(problem)).value
    assert plan.objective.value <= every.objective.value + (problem.layers - printed) * price + ROUNDING
    assert printed == 0 or nothing - plan.objective.value >= printed * price - ROUNDING


@given(cases(), st.booleans())
@settings(max_examples=examples(300))
def test_without_time_the_plan_is_the_better_of_nothing_and_the_first_one(case: Case, is_relaxed: bool) -> None:
    problem = case.mpc().problem(case.estimate, case.layer)
    droplets = np.random.default_rng(case.layer).random(problem.choices.shape) * (problem.choices > 0)
    found = best_plan(
        problem,
        DEFAULT_WORK,
        relaxed=droplets if is_relaxed else None,
        last=case.last,
        layer_worth=0.0,
        seed=0,
        seconds_max=0.0,
    )
    starts = [no_droplets(problem), diffuse(problem, droplets) if is_relaxed else full_layers(problem)]
    np.testing.assert_array_equal(found.plan, best_of(starts, problem))
    assert found.objective == bindings.objective(problem, found.plan)
    assert found.status is (PlanStatus.FALLBACK if found.plan.any() else PlanStatus.DONE)


@given(cases())
@settings(max_examples=examples(200))
def test_objective_is_that_of_the_layers_printed_one_after_the_other(case: Case) -> None:
    plan, problem, job = case.planned(), case.mpc().problem(case.estimate, case.layer), case.job
    model = replace(LayerModel.of(job), inks=case.estimate.inks)
    height = case.estimate.height
    for ahead, layer in enumerate(plan.plan):
        pattern, level = bindings.split(layer, len(job.inks))
        height = model.layer(height, pattern, case.layer + 1 + ahead, level.astype(np.float64))
        if ahead == 0:
            np.testing.assert_array_equal(plan.predicted_height, height)
    over, count, weight = height - job.target_height, job.mask.sum(), problem.weights
    error = (weight * (np.maximum(-over, 0.0) + case.criterion.overshoot * np.maximum(over, 0.0))).sum() / count
    excess = np.zeros(height.shape) if problem.ceiling is None else np.maximum(height - problem.ceiling, 0.0)
    above = problem.ceiling_cost * (weight * excess).sum() / count
    value = problem.alpha * (error + above) + (1.0 - problem.alpha) * height[job.mask].std()
    assert plan.objective.value == pytest.approx(value, rel=1e-9, abs=ROUNDING)


@given(cases())
@settings(max_examples=examples(200))
def test_same_question_gives_the_same_bits_again_with_any_number_of_threads(case: Case) -> None:
    kept, mpc = case.last.copy(), case.mpc()
    first = mpc.plan(case.estimate, case.layer, case.last)
    assert same(first, mpc.plan(case.estimate, case.layer, case.last))
    assert same(first, case.planned(threads=2))
    np.testing.assert_array_equal(case.last, kept)


def job_of(**changes: Any) -> Job:
    """A block of 4 x 4 cells with some fields changed."""
    fields: dict[str, Any] = {"nx": 4, "ny": 4, "pitch": 1e-4, "target_height": np.full((4, 4), 1e-5)}
    return Job(**{**fields, "mask": np.ones((4, 4), np.bool_), **changes})


def with_value(value: float) -> Any:
    heights = np.full((4, 4), 1e-5)
    heights[1, 2] = value
    return heights


@pytest.mark.parametrize(
    ("changes", "height", "message"),
    [
        ({}, with_value(np.nan), r"height is nan at cell \(1, 2\); needs finite values"),
        ({}, with_value(np.inf), r"height is inf at cell \(1, 2\); needs finite values"),
        ({}, np.zeros((4, 5)), r"height has shape \(4, 5\); needs \(4, 4\)"),
        ({}, with_value(0.6), r"height reaches 0.6 m with 5 layers to come"),
        ({"mask": np.zeros((4, 4), np.bool_)}, np.zeros((4, 4)), "part marks no cell"),
    ],
)
def test_what_no_surface_or_job_can_be_is_refused_with_a_message(changes: Any, height: Any, message: str) -> None:
    job = job_of(**changes)
    with pytest.raises(ValueError, match=message):
        LayerMpc(job).plan(Estimate.exact(height, job.inks), 0, np.zeros((3, 4, 4), np.int32))
