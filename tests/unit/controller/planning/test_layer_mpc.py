"""The layer controller: starts, relaxation, stop rule, budgets, materials, refusals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from inkloop.component import BoolMap, FloatMap, HeightIntervals, Ink, Job
from inkloop.geometry import contained
from inkloop_controller.baseline_planners import OpenLoop, StochasticGreedy
from inkloop_controller.controllers import LayerMpcController
from inkloop_controller.core import bindings
from inkloop_controller.core.bindings import diffuse
from inkloop_controller.estimation.estimate_figures import EstimateFigures
from inkloop_controller.estimation.height_estimator import Estimate
from inkloop_controller.model import DropletChoices, LayerModel
from inkloop_controller.planning import layer_mpc
from inkloop_controller.planning.horizon_planner import Finish, ending_of
from inkloop_controller.planning.layer_mpc import LayerMpc
from inkloop_controller.planning.layer_plan import LayerPlan, LeftOut, PlanStatus
from inkloop_controller.problem.criterion import Criterion, Work
from inkloop_controller.problem.horizon_problem import HorizonProblem, even_droplets
from inkloop_controller.program import certificate
from inkloop_controller.program.certificate import Certificate
from inkloop_controller.program.program import HorizonProgram, RelaxedPlan
from inkloop_controller.program.sequential_program import SequentialProgram
from support.closed_loop import block
from support.half_spaces import Above
from support.numpy.plan_starts_numpy import squeezed
from support.problem_plans import best_plan

INKS = (Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6))
ROUNDING = 9 * 2.0**-54  # [m], of the nine shares of a droplet, which are kept on the lattice of the core
ENGINES = [("highs", 1.0), ("ipopt", 1.0), ("ipopt", 0.8), ("ipopt", 0.3), ("ipopt", 0.0)]


def rough_job(seed: int = 0, n: int = 9, layers: float = 0.5) -> tuple[Job, Any]:
    """A block that wants half a layer more, or so many, on a rough surface."""
    height = np.random.default_rng(seed).uniform(0.0, 8e-6, (n, n - 1))
    return block(n, n - 1, float(height.mean()) + layers * 7.6e-6), height


def none(job: Job, layers: int = 1) -> Any:
    return np.zeros((layers, job.nx, job.ny), np.int32)


def known(height: Any, ink_scale: float = 1.0) -> Estimate:
    """A surface, and ink of that share of the nominal volume, known for sure."""
    return Estimate.exact(height, LayerModel((Ink(),)).scaled(ink_scale).inks)


def planned(job: Job, height: Any, last: Any = None, **options: Any) -> LayerPlan:
    """The plan for the first layer on a surface."""
    alpha = options.pop("alpha", 0.8)
    planner = LayerMpc(job, criterion=Criterion(alpha=alpha), **options)
    return planner.plan(Estimate.exact(height, job.inks), 0, none(job) if last is None else last)


@pytest.mark.parametrize(("relaxation", "alpha"), ENGINES)
def test_relaxed_optimum_is_below_every_pattern(relaxation: Any, alpha: float) -> None:
    job, height = rough_job()
    mpc = LayerMpc(job, criterion=Criterion(alpha=alpha), horizon=1, relaxation=relaxation)
    plan = mpc.plan(known(height), 0, none(job))
    assert 0.0 <= plan.bound < plan.objective.value
    assert plan.gap == pytest.approx(1.0 - plan.bound / plan.objective.value, rel=1e-9, abs=0.0)
    rng = np.random.default_rng(1)
    problem = mpc.problem(known(height), 0)
    for _ in range(100):
        pattern = (rng.integers(0, 2, (1, *height.shape)) * job.mask).astype(np.int32)
        assert plan.bound < bindings.objective(problem, pattern).value


@pytest.mark.parametrize(("horizon", "passes"), [(1, 1), (2, 1), (3, 1), (2, 4)])
def test_plan_of_linear_programs_is_not_worse_than_their_droplets_rounded(horizon: int, passes: int) -> None:
    job, height = rough_job(1, layers=0.6 * horizon)
    mpc = LayerMpc(replace(job, passes=passes), horizon=horizon, relaxation="slp")
    plan, problem = mpc.plan(known(height), 0, none(job)), mpc.problem(known(height), 0)
    droplets = SequentialProgram(problem).solve(problem, even_droplets(problem)).droplets
    used = replace(problem, droplet_std=0.0)
    assert bindings.objective(used, plan.plan).value <= bindings.objective(used, diffuse(problem, droplets)).value
    assert np.isnan(plan.bound)
    assert set(plan.seconds) == {"relaxation", "rounding", "repair"}
    assert plan.seconds["relaxation"] > 0.0


def test_droplets_of_the_solver_are_what_is_rounded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a repair, and with everything else worse."""
    job, height = rough_job(1, layers=1.0)
    seen = []
    solve = SequentialProgram.solve

    def watched(self: SequentialProgram, *given: Any) -> Any:
        seen.append(solve(self, *given))
        return seen[-1]

    monkeypatch.setattr(SequentialProgram, "solve", watched)
    mpc = LayerMpc(job, horizon=2, relaxation="slp", after_sweep=lambda progress: True)
    plan, problem = mpc.plan(known(height), 0, none(job)), mpc.problem(known(height), 0)
    rounded = bindings.objective(problem, diffuse(problem, seen[0].droplets)).value
    assert plan.start.startswith("relaxation")
    assert plan.objective.value <= rounded


def test_time_limit_cuts_the_solver_off_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    job, height = rough_job(1, layers=2.0)
    options: Any = {"horizon": 3, "relaxation": "slp", "work": Work(time_limit=1e9)}
    mpc = LayerMpc(job, **options)
    assert mpc.plan(known(height), 0, none(job)).left_out == LeftOut.NOTHING
    assert LeftOut.RELAXATION in mpc.plan(known(height), 0, none(job), elapsed=2e9).left_out
    monkeypatch.setattr(layer_mpc, "SOLVER_SHARE", 1e-12)
    for relaxation in ("slp", "ipopt"):
        late = LayerMpc(job, **{**options, "relaxation": relaxation})
        assert late.plan(known(height), 0, none(job)).left_out == LeftOut.RELAXATION


def test_relaxation_is_solved_again_for_every_layer() -> None:
    job, height = rough_job(2)
    options: Any = {"criterion": Criterion(alpha=1.0), "horizon": 1, "relaxation": "highs"}
    mpc = LayerMpc(job, **options)
    first = mpc.plan(known(height), 0, none(job))
    second = mpc.plan(known(height[::-1] + 1e-6, 0.8), 1, first.plan)
    fresh = LayerMpc(job, **options).plan(known(height[::-1] + 1e-6, 0.8), 1, first.plan)
    assert second.bound == pytest.approx(fresh.bound, rel=1e-9, abs=0.0)
    assert second.bound != pytest.approx(first.bound, rel=1e-3, abs=0.0)


def test_surface_is_predicted_only_where_it_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    job, height = rough_job(3)
    asked = []
    monkeypatch.setattr(LayerModel, "layer", lambda *_: asked.append(1) or height)
    plan = LayerMpc(job, horizon=2).plan(known(height), 0, none(job))
    assert asked == []
    assert plan.predicted_height is plan.predicted_height
    assert asked == [1]


@pytest.mark.parametrize("horizon", [2, 3, 5])
def test_plan_made_where_the_last_one_has_led_is_not_worse(horizon: int) -> None:
    """The rest of that plan after an empty layer ends on the same surface."""
    criterion = Criterion(alpha=0.8, layer_worth=0.0, droplet_std=0.0)
    for seed in range(2):
        job, height = rough_job(seed, 13, layers=2.5)
        mpc, last, before = LayerMpc(job, criterion=criterion, horizon=horizon), none(job), np.inf
        for layer in range(4):
            plan = mpc.plan(known(height), layer, last)
            assert plan.objective.value <= before + ROUNDING
            height, last, before = plan.predicted_height, plan.plan, plan.objective.value


@pytest.mark.parametrize("seed", [16, 56, 66])
def test_start_wins_nothing_by_leaving_an_empty_layer_at_the_end(seed: int) -> None:
    """Such a layer hides what the last droplets leave to chance. The rounded droplets begin with an empty one here,
    and moved to the first layer they would seem better than the same ones repaired.
    """
    height = np.random.default_rng(seed).uniform(0.0, 8e-6, (4, 4))
    choices, everywhere = np.ones((2, 4, 4), np.uint16), np.ones((4, 4), np.bool_)
    problem = HorizonProblem(height, np.full((4, 4), 10e-6), everywhere, choices, (Ink(),), 0.8, droplet_std=0.4)
    work, nothing = Work(sweeps=2, annealing_sweeps=0), np.zeros((0, 4, 4), np.int32)
    plan = best_plan(problem, work, last=nothing, layer_worth=0.0, seed=1, seconds_max=np.inf)
    assert plan.status is PlanStatus.BUDGET


def test_no_layer_is_left_that_its_own_droplets_can_do_without() -> None:
    """Where they fit into later layers for less than the layer is worth; the last layer printed ends the horizon."""
    layers = []
    for seed in range(3):
        job, height = rough_job(seed, 9, layers=1.2)
        criterion, work = Criterion(layer_worth=0.01, droplet_std=0.2), Work(annealing_sweeps=0)
        mpc, last = LayerMpc(job, criterion=criterion, work=work), none(job)
        for layer in range(3):
            plan, problem = mpc.plan(known(height), layer, last), mpc.problem(known(height), layer)
            height, last, used = plan.predicted_height, plan.plan, int(np.count_nonzero(plan.plan.any((1, 2))))
            layers.append(used)
            printed, fewer = (replace(problem, choices=problem.choices[: max(1, n)]) for n in (used, used - 1))
            assert plan.objective == bindings.objective(printed, plan.plan[: max(1, used)])
            if used > 1:
                rest = bindings.objective(fewer, squeezed(plan.plan[:used], fewer)).value
                assert rest > plan.objective.value + 0.01 * job.inks[0].layer_height
    assert max(layers) > 1


@pytest.mark.parametrize("alpha", [0.1, 0.8, 1.0])
def test_finished_part_is_done(alpha: float) -> None:
    job = block()
    surface = Estimate.exact(job.target_height, job.inks)
    for planner in (LayerMpc(job, criterion=Criterion(alpha=alpha)), StochasticGreedy(job, alpha=alpha)):
        plan = planner.plan(surface, 4, none(job))
        assert plan.status is PlanStatus.DONE
        assert not plan.pattern.any()


def test_print_is_done_when_no_layer_is_worth_it() -> None:
    """One cell of 49 lacks a droplet: that is 0.09 um of the mean error."""
    job = block(11, 11)
    surface = job.target_height.copy()
    surface[5, 5] -= 5e-6
    gain = planned(job, surface, alpha=1.0, finish="even")
    assert np.argwhere(gain.pattern).tolist() == [[5, 5]]
    lost = LayerMpc(job, criterion=Criterion(alpha=1.0, layer_worth=0.02)).plan(known(surface), 0, none(job))
    assert (lost.status, lost.start) == (PlanStatus.DONE, "nothing")
    assert not lost.plan.any()
    assert lost.objective.error == pytest.approx(5e-6 / 49, rel=1e-9, abs=0.0)


def test_print_that_is_done_is_not_said_to_be_annealed() -> None:
    starts = []
    for seed in range(4):
        job, height = rough_job(seed)
        starts.append(planned(job, height, horizon=1).start)
        dear = LayerMpc(job, horizon=1, criterion=Criterion(layer_worth=1.0)).plan(known(height), 0, none(job))
        assert (dear.status, dear.start) == (PlanStatus.DONE, "nothing")
    assert any(start.endswith(", annealed") for start in starts)


@pytest.mark.parametrize(("worth", "levels", "is_done"), [(0.7, 1, False), (1.5, 1, True), (1.2, 2, False)])
def test_each_layer_of_a_plan_has_to_be_worth_its_price(worth: float, levels: int, is_done: bool) -> None:
    """Two layers lower the mean error by nearly two layers, which is more than the price of one of 1.5 layers. With
    drops of two sizes one layer does, whose price goes by the smallest drops."""
    job = block(13, 13)
    job = replace(job, target_height=np.where(job.mask, 2.0 * job.inks[0].layer_height, 0.0))
    choices = DropletChoices(job, drop_levels=levels)
    mpc = LayerMpc(job, horizon=2, criterion=Criterion(alpha=1.0, layer_worth=worth), choices=choices)
    plan = mpc.plan(known(np.zeros_like(job.target_height)), 0, none(job))
    assert (plan.status is PlanStatus.DONE) == is_done
    assert plan.plan.any() == (not is_done)


def test_given_horizon_and_worth_stand_instead_of_those_of_the_finish() -> None:
    job, height = rough_job(2)
    endings: dict[Finish, tuple[int, float]] = {"even": (5, 0.0015), "fast": (4, 0.007)}
    for finish, (horizon, worth) in endings.items():
        assert ending_of(finish).layer_worth == worth
        chosen = LayerMpc(job, finish=finish)
        assert chosen.problem(known(height), 0).layers == horizon
        assert LayerMpc(job, finish=finish, horizon=2).problem(known(height), 0).layers == 2
        given = LayerMpc(job, finish="even", horizon=horizon, criterion=Criterion(layer_worth=worth))
        np.testing.assert_array_equal(
            chosen.plan(known(height), 0, none(job)).plan, given.plan(known(height), 0, none(job)).plan
        )


@pytest.mark.parametrize("layer", [3, 4])
def test_problem_has_what_the_job_the_criterion_and_the_estimate_say(layer: int) -> None:
    """Layer 5, which follows layer 4, is one in which dead cells are tried again."""
    rng = np.random.default_rng(3)
    shape = (7, 5)
    part = np.zeros(shape, np.bool_)
    part[1:5, 1:4] = True
    target = np.where(part, 90e-6, 0.0) + rng.uniform(0.0, 1e-6, shape)
    job = Job(*shape, 254e-6, target, part, INKS, Above(40e-6), passes=4, pass_order=2, pass_rotation=1)
    criterion = Criterion(
        alpha=[(1, 0.5), (5, 0.7)], overshoot_limit=6e-6, chance_margin=2.0, fringe_weight=0.25, droplet_std=0.3
    )
    dead, capped = np.zeros(shape, np.bool_), np.zeros(shape, np.bool_)
    dead[2, 3], capped[3, 2] = True, True
    learnt = (Ink(4.1e-6, 0.5e-6, 0.1e-6), Ink(3.7e-6, 0.4e-6, 0.2e-6))
    exact = Estimate.exact(rng.uniform(0.0, 30e-6, shape), learnt)
    variance = rng.uniform(1e-13, 2e-13, shape)
    estimate = replace(exact, height_variance=variance, dead=dead, capped=capped)
    mpc = LayerMpc(job, criterion=criterion, horizon=3, choices=DropletChoices(job, drop_levels=2))
    problem = mpc.problem(estimate, layer)
    assert problem.layers == 3
    np.testing.assert_array_equal(problem.height, estimate.height)
    np.testing.assert_array_equal(problem.target, target)
    np.testing.assert_array_equal(problem.part, part)
    assert problem.kinds == (*learnt, *(Ink(2 * ink.h1, 2 * ink.h2, 2 * ink.h3) for ink in learnt))
    layer_height = sum(ink.layer_height for ink in INKS) / 2.0
    middles = estimate.height + layer_height * (np.arange(3)[:, None, None] + 0.5)
    expected = np.where(part, np.where(middles >= 40e-6, 0b0101, 0b1010), 0)
    assert {0b0101, 0b1010} <= set(np.unique(expected))
    expected[:, 3, 2] = 0
    expected[1 if layer == 4 else 0 :, 2, 3] = 0
    np.testing.assert_array_equal(problem.choices, expected)
    assert problem.alpha == {3: 0.5, 4: 0.7}[layer]
    ring = np.zeros(shape)
    ring[0:6, 0:5] = 0.25
    np.testing.assert_array_equal(problem.weights, np.where(part, 1.0, ring))
    assert problem.overshoot == pytest.approx(1.0 + 1.2 * 0.3, rel=1e-12, abs=0.0)
    squares = max(ink.h1**2 + 4 * ink.h2**2 + 4 * ink.h3**2 for ink in learnt)
    assert problem.ceiling is not None
    np.testing.assert_allclose(
        problem.ceiling[part], (target + 6e-6 - 2.0 * np.sqrt(variance + 0.01 * squares))[part], rtol=1e-12
    )
    assert (problem.ceiling[~part] > 0.1).all()
    assert problem.ceiling_cost == 100.0
    assert problem.droplet_std == 0.3
    model = LayerModel.of(job)
    assert problem.colours == tuple(model.colours(layer + ahead) for ahead in (1, 2, 3))
    assert len({*problem.colours}) > 1


def test_droplets_vary_as_learnt_unless_they_are_told_to_or_a_bound_is_asked_for() -> None:
    job, height = rough_job()
    estimate = replace(known(height), figures=EstimateFigures(droplet_std=0.12))
    assert LayerMpc(job, horizon=1).problem(estimate, 0).droplet_std == 0.12
    assert LayerMpc(job, horizon=1, criterion=Criterion(droplet_std=0.25)).problem(estimate, 0).droplet_std == 0.25
    exact = {"horizon": 1, "criterion": Criterion(alpha=1.0, droplet_std=0.25)}
    for bounded in ({"certified": True}, {"relaxation": "highs"}):
        problem = LayerMpc(job, **exact, **bounded).problem(estimate, 0)  # type: ignore[arg-type]
        assert problem.droplet_std == 0.0
        assert problem.ceiling is None
        assert problem.weight is None


@pytest.mark.parametrize(("options", "near", "far"), [({}, 3, 5), ({"finish": "fast"}, 3, 4), ({"horizon": 4}, 4, 4)])
def test_plans_for_a_foreign_plant_look_less_far_ahead_unless_the_horizon_is_given(
    options: Mapping[str, Any], near: int, far: int
) -> None:
    job, height = rough_job(layers=2.5)
    planner, usual = LayerMpc(job, **options), known(height)
    foreign = replace(usual, figures=EstimateFigures(is_foreign=True))
    assert len(planner.problem(usual, 0).choices) == far
    assert len(planner.problem(foreign, 0).choices) == near
    plan = planner.plan(foreign, 0, none(job)).plan
    assert plan.shape == (far, *height.shape)
    assert plan[0].any()
    assert not plan[near:].any()


def test_certified_plan_comes_with_a_proven_bound() -> None:
    job, height = rough_job(5)
    plan = planned(job, height, alpha=1.0, horizon=1, certified=True)
    assert plan.bound_confidence == 1.0
    assert plan.gap <= 0.01
    assert "certificate" in plan.seconds
    assert plan.left_out is LeftOut.NOTHING


def test_exact_plan_is_optimal_by_its_bound() -> None:
    job = block(8, 8, 0.0)
    target = LayerModel.of(job).layer(np.zeros((8, 8)), job.mask.astype(np.int32))
    job = Job(8, 8, job.pitch, target, job.mask)
    plan = planned(job, np.zeros((8, 8)), alpha=1.0, horizon=1, relaxation="highs")
    assert plan.status is PlanStatus.OPTIMAL
    np.testing.assert_array_equal(plan.pattern, job.mask)


def test_plan_is_optimal_only_if_nothing_but_rounding_is_between_it_and_its_bound() -> None:
    """Ten nanometres on one of 16 cells are 8e-5 of a layer. A droplet that is a little smaller would do with less."""
    job = block(8, 8, 0.0)
    target = LayerModel.of(job).layer(np.zeros((8, 8)), job.mask.astype(np.int32))
    target[4, 4] -= 10e-9
    plan = planned(replace(job, target_height=target), np.zeros((8, 8)), alpha=1.0, horizon=1, relaxation="highs")
    assert plan.status is PlanStatus.REPAIRED
    assert plan.objective.value == pytest.approx(10e-9 / 16, rel=1e-3, abs=0.0)


def test_finished_part_is_done_and_not_optimal_with_any_bound() -> None:
    job = block()
    for options in ({"certified": True}, {"relaxation": "highs"}):
        plan = planned(job, job.target_height, alpha=1.0, horizon=1, **options)
        assert plan.status is PlanStatus.DONE
        assert np.isnan(plan.bound) == ("certified" in options)
        assert "certificate" not in plan.seconds


@pytest.mark.parametrize(("certified_um", "expected"), [(0.0, 1.0), (90.0, 0.95)])
def test_bound_is_the_higher_one_of_the_certificate_and_the_relaxation(
    certified_um: float, expected: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    job, height = rough_job(5)
    alone = planned(job, height, alpha=1.0, horizon=1, relaxation="highs")
    found = Certificate(1e-6, certified_um * 1e-6, 0.95, 4, 3, 2, 0.1)
    monkeypatch.setattr(certificate, "certify", lambda *_, **__: found)
    plan = planned(job, height, alpha=1.0, horizon=1, relaxation="highs", certified=True)
    assert plan.bound == pytest.approx(max(alone.bound, found.bound), rel=1e-9, abs=0.0)
    assert plan.bound_confidence == expected


def test_certificate_that_there_is_no_time_for_is_reported() -> None:
    job, height = rough_job(5)
    criterion, work = Criterion(alpha=1.0), Work(time_limit=1e9)
    mpc = LayerMpc(job, criterion=criterion, horizon=1, certified=True, work=work)
    assert LeftOut.CERTIFICATE in mpc.plan(known(height), 0, none(job), elapsed=2e9).left_out
    assert mpc.plan(known(height), 0, none(job)).left_out == LeftOut.NOTHING


def test_without_a_relaxation_nothing_is_rounded() -> None:
    job, height = rough_job(2)
    plain, usual = (planned(job, height, relaxation=name, horizon=2) for name in ("none", "gradient"))
    assert plain.seconds["relaxation"] == 0.0 < usual.seconds["relaxation"]
    assert "relaxation" not in plain.start


def test_solver_that_fails_leaves_its_droplets_out_and_no_time_limit_is_said_to_have_done_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    job, height = rough_job(1)
    rounded: list[Any] = []

    def watched(*given: Any, relaxed: Any, **options: Any) -> Any:
        rounded.append(relaxed)
        return best(*given, relaxed=relaxed, **options)

    best = vars(layer_mpc)["best_plan"]
    monkeypatch.setattr(layer_mpc, "best_plan", watched)
    monkeypatch.setattr(SequentialProgram, "solve", lambda self, problem, start: failed(start))
    monkeypatch.setattr(HorizonProgram, "solve", lambda self, problem, start: failed(start))
    for relaxation, is_kept in (("slp", True), ("ipopt", False)):
        plan = planned(job, height, horizon=1, relaxation=relaxation)
        assert (rounded.pop() is not None) == is_kept
        assert plan.left_out == LeftOut.NOTHING


def failed(start: Any) -> RelaxedPlan:
    return RelaxedPlan(start, 1.0, np.nan, False, "failed")


def test_solver_serves_every_alpha_and_horizon_of_a_print() -> None:
    job, height = rough_job(1, 7)
    criterion = Criterion(alpha=[(1, 1.0), (2, 0.8)])
    mpc = LayerMpc(job, criterion=criterion, finish="fast", relaxation="ipopt", work=Work(annealing_sweeps=0, sweeps=1))
    foreign = replace(known(height), figures=EstimateFigures(is_foreign=True))
    for layer in (0, 1):
        for estimate in (known(height), foreign):
            assert mpc.plan(estimate, layer, none(job)).plan.shape == (4, *height.shape)


def test_dead_nozzle_jets_nothing_and_does_not_keep_the_print_from_ending() -> None:
    job = block(9, 9, 0.0)
    choices = DropletChoices(job, dead_nozzles=(4,))
    surface = np.where(np.arange(9) == 4, 0.0, job.target_height + 20e-6)
    plan = planned(job, surface, choices=choices)
    assert plan.status is PlanStatus.DONE
    low = planned(job, np.full((9, 9), -20e-6), choices=choices)
    assert low.pattern.any()
    assert not low.pattern[:, 4].any()


def test_grey_head_takes_larger_drops_where_more_is_lacking() -> None:
    job = block(9, 9, 30e-6)
    height = np.zeros((9, 9))
    height[:, :4] = 22e-6
    plan = planned(job, height, horizon=1, choices=DropletChoices(job, drop_levels=4))
    assert set(np.unique(plan.pattern)) == {0, 1}
    assert plan.drop_level[2:-2, 5:7].mean() > plan.drop_level[2:-2, 2:4].mean() + 1.0
    predicted = LayerModel.of(job).layer(height, plan.pattern, 1, plan.drop_level.astype(np.float64))
    np.testing.assert_array_equal(plan.predicted_height, predicted)


def test_ceiling_is_kept_where_the_plain_criterion_would_pass_it() -> None:
    job, height = rough_job(5)
    limit = 1e-6
    free = planned(job, height)
    kept = LayerMpc(job, criterion=Criterion(overshoot_limit=limit)).plan(known(height), 0, none(job))
    room = job.target_height + limit
    risen = job.mask & (height <= room)
    after = LayerModel.of(job)
    tops = []
    for plan in (free, kept):
        surface = height
        for number, layer in enumerate(plan.plan, start=1):
            surface = after.layer(surface, layer, number)
        tops.append(float((surface - room)[risen].max()))
    assert tops[0] > 0.0
    assert tops[1] <= 1e-12


def test_ceiling_of_the_part_does_not_forbid_what_spills_next_to_it() -> None:
    job = block()
    flat = np.zeros((job.nx, job.ny))
    limited = LayerMpc(job, criterion=Criterion(overshoot_limit=1e-6, fringe_weight=0.1), horizon=3)
    np.testing.assert_array_equal(limited.plan(known(flat), 0, none(job)).pattern, job.mask)


def test_estimate_that_took_all_the_time_leaves_the_first_sound_plan() -> None:
    job, height = rough_job(6, 30)
    planner = LayerMpc(job, work=Work(time_limit=1e9))
    late = planner.plan(known(height), 0, none(job), elapsed=2e9)
    assert late.status is PlanStatus.FALLBACK
    assert late.pattern.any()
    assert late.left_out >= LeftOut.RELAXATION | LeftOut.STARTS | LeftOut.REPAIR
    assert planner.plan(known(height), 0, none(job), elapsed=2.0).left_out == LeftOut.NOTHING


def test_after_sweep_ends_all_repairs_with_the_best_plan_so_far() -> None:
    def interrupt(progress: Any) -> bool:
        raise KeyboardInterrupt

    job, height = rough_job(7)
    sweeps = []
    enough = planned(job, height, after_sweep=lambda progress: bool(sweeps.append(progress.sweeps)) or True)
    assert len(sweeps) == 1
    assert enough.status in (PlanStatus.INTERRUPTED, PlanStatus.FALLBACK)
    watched = planned(job, height, after_sweep=lambda progress: bool(sweeps.append(progress.sweeps)))
    assert len(sweeps) == 1 + watched.sweeps
    assert watched.objective.value <= enough.objective.value
    interrupted = planned(job, height, after_sweep=interrupt)
    assert interrupted.status is PlanStatus.INTERRUPTED
    assert interrupted.pattern.any()
    with pytest.raises(ZeroDivisionError):
        planned(job, height, after_sweep=lambda progress: bool(1 / 0))


def test_last_plan_that_no_plan_can_be_is_refused() -> None:
    job, height = rough_job(8)
    for wrong in (17, -1):
        with pytest.raises(ValueError, match=f"last holds {min(wrong, 0)} to {max(wrong, 0)}; needs 0 to 16"):
            planned(job, height, last=np.where(job.mask, wrong, 0)[None].astype(np.int32))
    planned(job, height, last=np.where(job.mask, 16, 0)[None].astype(np.int32))


def test_last_plan_of_another_grid_is_not_used() -> None:
    job, height = rough_job(8)
    without = planned(job, height, horizon=1)
    for shape in ((3, 4, 4), (3, job.ny, job.nx), (0, job.nx, job.ny)):
        plan = planned(job, height, last=np.ones(shape, np.int32), horizon=1)
        np.testing.assert_array_equal(plan.plan, without.plan)
        assert plan.start == without.start


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda job: LayerMpcController(job, finish="slow"), "finish is 'slow'; needs one of even, fast"),
        (lambda job: LayerMpc(job, horizon=0), "horizon is 0"),
        (lambda job: LayerMpc(job, horizon=6), "needs 1 to 5 layers"),
        (
            lambda job: LayerMpc(job, relaxation="highs"),
            "'highs' with horizon 5, alpha 0.8 and 1 pass.*set these, or relaxation = 'slp'",
        ),
        (lambda job: LayerMpc(job, horizon=1, relaxation="highs"), "needs horizon = 1, alpha = 1 and 1 pass"),
        (lambda job: LayerMpc(job, certified=True), "certified with horizon 5"),
        (lambda job: Work(sweeps=0, threads=0), "sweeps is 0.*threads is 0"),
        (lambda job: Work(time_limit=0.0), "time_limit is 0"),
        (lambda job: StochasticGreedy(job, alpha=2.0), "alpha is 2.0"),
        (lambda job: StochasticGreedy(job, batch=0), "batch is 0"),
        (lambda job: StochasticGreedy(job, iterations_max=0), "batch is 20 and iterations_max 0"),
        (
            lambda job: LayerMpc(replace(job, passes=4), criterion=Criterion(alpha=1.0), horizon=1, relaxation="highs"),
            r"relaxation is 'highs' with horizon 1, alpha 1.0 and 4 pass",
        ),
        (lambda job: StochasticGreedy(block(passes=4)), "passes is 4; this controller plans layers of 1 pass"),
        (lambda job: OpenLoop(job, layers=-1), "layers is -1"),
    ],
)
def test_impossible_option_is_refused(make: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make(block())


@pytest.mark.parametrize(
    ("height_um", "given", "layers"), [(30.4, None, 4), (26.5, None, 3), (26.7, None, 4), (30.4, 2, 2), (30.4, 0, 0)]
)
def test_open_loop_prints_full_layers_up_to_the_nominal_height(
    height_um: float, given: int | None, layers: int
) -> None:
    """A layer has 7.6 um; their number is rounded."""
    job = block(height=height_um * 1e-6)
    planner = OpenLoop(job, layers=given)
    flat = Estimate.exact(np.zeros((job.nx, job.ny)), job.inks)
    plans = [planner.plan(flat, layer, none(job)) for layer in range(layers + 1)]
    assert [plan.status for plan in plans] == [PlanStatus.FIXED] * layers + [PlanStatus.DONE]
    for plan in plans[:layers]:
        np.testing.assert_array_equal(plan.pattern, job.mask)


def test_region_is_asked_in_metres_from_the_first_cell() -> None:
    asked: list[Any] = []

    class Asked:
        def contains(self, x: FloatMap, y: FloatMap, z: FloatMap) -> BoolMap:
            return contained(self.intervals(x, y), z)

        def intervals(self, x: FloatMap, y: FloatMap) -> HeightIntervals:
            asked.extend([x, y])
            return ((np.full_like(x, -np.inf), np.full_like(x, np.inf)),)

    job = block(4 + 5, 4 + 2, inks=INKS, region=Asked())
    LayerMpc(job)
    i, j = np.indices((9, 6))
    np.testing.assert_allclose(asked[0], i * job.pitch)
    np.testing.assert_allclose(asked[1], j * job.pitch)


@pytest.mark.parametrize("planner", [LayerMpc, StochasticGreedy, OpenLoop])
def test_every_droplet_is_of_the_ink_that_belongs_there(planner: Any) -> None:
    lower = block(inks=INKS, region=Above(5e-6))
    upper = block(inks=INKS, region=Above(-5e-6))
    for job, pattern in ((lower, 2), (upper, 1)):
        plan = planner(job).plan(Estimate.exact(np.zeros((job.nx, job.ny)), job.inks), 0, none(job))
        assert set(np.unique(plan.pattern[job.mask])) - {0} == {pattern}
        assert not plan.pattern[~job.mask].any()
