"""The layer problem: starts, relaxation, stop rule, materials, refusals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from closed_loop import block
from inkloop.component import BoolMap, FloatMap, Ink, Job
from inkloop_controller import one_layer as core
from inkloop_controller.baselines import OpenLoop, StochasticGreedy
from inkloop_controller.layer_model import LayerModel
from inkloop_controller.layer_mpc import LayerMpc, layer_problem
from inkloop_controller.layer_plan import PlanStatus, layer_objective
from inkloop_controller.regions import materials

INKS = (Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6))
ENGINES = [("highs", 1.0), ("ipopt", 1.0), ("ipopt", 0.8), ("ipopt", 0.3), ("ipopt", 0.0)]


@dataclass(frozen=True)
class Above:
    """Everything above a height [m]."""

    z: float

    def contains(self, x: FloatMap, y: FloatMap, z: FloatMap) -> BoolMap:
        return np.broadcast_to(z > self.z, np.broadcast_shapes(x.shape, z.shape))


def rough_job(seed: int = 0, n: int = 9) -> tuple[Job, Any]:
    """A block that wants half a layer more on a rough surface."""
    height = np.random.default_rng(seed).uniform(0.0, 8e-6, (n, n))
    return block(n, n, float(height.mean()) + 3.8e-6), height


def none(job: Job) -> Any:
    return np.zeros((job.nx, job.ny), np.int32)


@pytest.mark.parametrize(("relaxation", "alpha"), ENGINES)
def test_relaxed_optimum_is_below_every_pattern(relaxation: Any, alpha: float) -> None:
    job, height = rough_job()
    plan = LayerMpc(job, alpha=alpha, relaxation=relaxation).plan(height, 1.0, 0, none(job))
    assert plan.bound_valid
    assert 0.0 <= plan.bound < plan.objective
    rng = np.random.default_rng(1)
    problem = layer_problem(job, height, 1.0, alpha, "middle")
    for _ in range(100):
        pattern = (rng.integers(0, 2, height.shape) * job.mask).astype(np.int32)
        assert plan.bound < core.objective(problem, pattern)


def test_both_relaxations_agree_where_both_apply() -> None:
    job, height = rough_job(1)
    ipopt, highs = (
        LayerMpc(job, alpha=1.0, relaxation=name).plan(height, 1.0, 0, none(job)).bound  # type: ignore[arg-type]
        for name in ("ipopt", "highs")
    )
    assert ipopt == pytest.approx(highs, abs=1e-12)


def test_relaxation_is_solved_anew_for_every_layer() -> None:
    job, height = rough_job(2)
    mpc = LayerMpc(job, alpha=1.0, relaxation="highs")
    first = mpc.plan(height, 1.0, 0, none(job))
    second = mpc.plan(height[::-1] + 1e-6, 0.8, 1, first.pattern)
    fresh = LayerMpc(job, alpha=1.0, relaxation="highs").plan(height[::-1] + 1e-6, 0.8, 1, first.pattern)
    assert second.bound == pytest.approx(fresh.bound, rel=1e-9)
    assert second.bound != pytest.approx(first.bound, rel=1e-3)


@pytest.mark.parametrize("alpha", [0.1, 0.5, 1.0])
def test_plan_is_never_worse_than_nothing_everything_or_the_last_layer(alpha: float) -> None:
    for seed in range(20):
        job, height = rough_job(seed)
        last = (np.random.default_rng(seed + 100).integers(0, 2, height.shape) * job.mask).astype(np.int32)
        plan = LayerMpc(job, alpha=alpha).plan(height, 1.0, 0, last)
        problem = layer_problem(job, height, 1.0, alpha, "middle")
        for other in (none(job), job.mask.astype(np.int32), last):
            assert plan.objective <= core.objective(problem, other)


def test_objective_is_that_of_the_predicted_surface() -> None:
    job, height = rough_job(3)
    plan = LayerMpc(job, alpha=0.6).plan(height, 0.9, 0, none(job))
    np.testing.assert_array_equal(plan.predicted_height, LayerModel(job.inks).scaled(0.9).layer(height, plan.pattern))
    expected = layer_objective(plan.predicted_height, job.target_height, job.mask, 0.6)
    assert plan.objective == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("planner", [LayerMpc, StochasticGreedy])
@pytest.mark.parametrize("alpha", [0.1, 0.8, 1.0])
def test_finished_part_is_done(planner: Any, alpha: float) -> None:
    job = block()
    plan = planner(job, alpha=alpha).plan(job.target_height, 1.0, 4, none(job))
    assert plan.status is PlanStatus.DONE
    assert not plan.pattern.any()


def test_horizon_beyond_one_layer_is_refused() -> None:
    with pytest.raises(ValueError, match="horizon is 2; this version looks 1 layer ahead"):
        LayerMpc(block(), horizon=2)


@pytest.mark.parametrize("planner", [LayerMpc, StochasticGreedy])
def test_four_passes_are_refused_by_planners_of_one(planner: Any) -> None:
    with pytest.raises(ValueError, match="passes is 4; this version plans layers of 1 pass"):
        planner(block(passes=4))


@pytest.mark.parametrize(
    ("planner", "options", "words"),
    [
        (LayerMpc, {"alpha": -0.1}, "alpha is -0.1"),
        (LayerMpc, {"sweeps": 0}, "sweeps is 0"),
        (LayerMpc, {"relaxation": "highs"}, "take 'ipopt'"),
        (StochasticGreedy, {"alpha": 2.0}, "alpha is 2.0"),
        (StochasticGreedy, {"batch": 0}, "batch is 0"),
        (OpenLoop, {"layers": -1}, "layers is -1"),
    ],
)
def test_option_that_cannot_be_meant_is_refused(planner: Any, options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        planner(block(), **options)


def test_open_loop_prints_full_layers_up_to_the_nominal_height() -> None:
    job = block(height=30.4e-6)  # four layers of 7.6 um
    planner = OpenLoop(job)
    plans = [planner.plan(np.zeros((job.nx, job.ny)), 1.0, layer, none(job)) for layer in range(5)]
    assert [plan.status for plan in plans] == [PlanStatus.FIXED] * 4 + [PlanStatus.DONE]
    for plan in plans[:4]:
        np.testing.assert_array_equal(plan.pattern, job.mask)


def test_material_is_asked_for_half_a_layer_above_the_surface() -> None:
    job = block(inks=INKS, region=Above(10e-6))
    half_layer = (7.6e-6 + 6.7e-6) / 4
    for test, surface in (("middle", 10e-6 - half_layer), ("surface", 10e-6)):
        shape = (job.nx, job.ny)
        assert (materials(job, np.full(shape, surface - 1e-9), test) == 1).all()  # type: ignore[arg-type]
        assert (materials(job, np.full(shape, surface + 1e-9), test) == 0).all()  # type: ignore[arg-type]


def test_region_is_asked_in_metres_from_the_first_cell() -> None:
    asked: list[Any] = []

    class Asked:
        def contains(self, x: FloatMap, y: FloatMap, z: FloatMap) -> BoolMap:
            asked.extend([x, y])
            return np.ones(z.shape, np.bool_)

    job = block(4 + 5, 4 + 2, inks=INKS, region=Asked())
    materials(job, np.zeros((9, 6)), "middle")
    i, j = np.indices((9, 6))
    np.testing.assert_allclose(asked[0], i * job.pitch)
    np.testing.assert_allclose(asked[1], j * job.pitch)


@pytest.mark.parametrize("planner", [LayerMpc, StochasticGreedy, OpenLoop])
def test_every_droplet_is_of_the_ink_that_belongs_there(planner: Any) -> None:
    lower = block(inks=INKS, region=Above(5e-6))
    upper = block(inks=INKS, region=Above(-5e-6))
    for job, pattern in ((lower, 2), (upper, 1)):
        plan = planner(job).plan(np.zeros((job.nx, job.ny)), 1.0, 0, none(job))
        assert set(np.unique(plan.pattern[job.mask])) - {0} == {pattern}
        assert not plan.pattern[~job.mask].any()
