"""A certificate never promises more than the proven optimum allows."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any, ClassVar

import numpy as np
import pytest
from scipy.stats import t

from inkloop.component import Ink
from inkloop_controller.core import bindings
from inkloop_controller.problem.horizon_problem import HorizonProblem, IntPlan
from inkloop_controller.program.certificate import Certificate, certify
from inkloop_controller.program.program import HorizonProgram
from support.core_search import search
from support.long_proofs import rest_is_long


def rough(shape: tuple[int, int], seed: int = 0, **values: Any) -> HorizonProblem:
    height = np.random.default_rng(seed).uniform(0.0, 8e-6, shape)
    target = np.full(shape, height.mean() + 3.8e-6)
    choices = np.ones((1, *shape), np.uint16)
    return HorizonProblem(height, target, np.ones(shape, np.bool_), choices, (Ink(),), **{"alpha": 1.0, **values})


@cache
def small(seed: int = 0) -> tuple[HorizonProblem, Certificate]:
    """A problem on a small grid, and the certificate of the plan that the search finds."""
    problem = rough((5, 5), seed)
    return problem, certify(problem, searched(problem))


def searched(problem: HorizonProblem) -> IntPlan:
    return search(problem, np.zeros(problem.choices.shape, np.int32), sweeps_max=50).plan


@pytest.mark.parametrize("seed", range(3))
def test_small_grid_is_proven(seed: int) -> None:
    problem, certificate = small(seed)
    best = HorizonProgram(problem, "highs", whole=True).solve(problem)
    assert certificate.confidence == 1.0
    assert certificate.bound <= best.value <= certificate.objective * (1 + 1e-9)
    assert certificate.bound == pytest.approx(best.value, rel=1e-3, abs=0.0)
    assert 0.0 <= certificate.gap < 0.2


@cache
def holed(seed: int) -> tuple[HorizonProblem, float]:
    """A grid that tiles do not divide, a part with a hole, a fringe, dead cells and a ceiling; and its optimum."""
    rng = np.random.default_rng(seed)
    plain = rough((7, 8), seed)
    part = rng.random((7, 8)) < 0.9
    problem = replace(
        plain,
        part=part,
        weight=np.where(part, 1.0, 0.3),
        choices=(rng.random((1, 7, 8)) < 0.9).astype(np.uint16),
        overshoot=2.0,
        ceiling=plain.target + 1e-6,
        ceiling_cost=5.0,
    )
    return problem, HorizonProgram(problem, "highs", whole=True).solve(problem).value


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("tile", [3, 4])
def test_all_tiles_together_bound_the_optimum(seed: int, tile: int) -> None:
    problem, best = holed(seed)
    certificate = certify(problem, searched(problem), whole_max=0, tile=tile)
    assert certificate.tiles == certificate.tiles_solved == certificate.tiles_proven
    assert certificate.confidence == 1.0
    assert 0.3 * best < certificate.bound <= best


def test_sampled_bound_keeps_below_the_optimum() -> None:
    problem = rough((10, 10), 1)
    plan = searched(problem)
    best = HorizonProgram(problem, "highs", whole=True, seconds_max=20.0).solve(problem).bound
    for seed in range(5):
        certificate = certify(problem, plan, whole_max=0, tile=4, tiles_max=5, seed=seed)
        assert (certificate.tiles, certificate.tiles_solved, certificate.confidence) == (9, 5, 0.95)
        assert certificate.bound <= best


class Remembering(HorizonProgram):
    """Solves the problem of each tile once, and gives the same answer to every later call."""

    known: ClassVar[dict[bytes, Any]] = {}

    def __init__(self, problem: HorizonProblem, *engine: Any, **options: Any) -> None:
        self.make = lambda: HorizonProgram(problem, *engine, **options)

    def solve(self, problem: HorizonProblem, *start: Any) -> Any:
        key = problem.height.tobytes() + problem.target.tobytes()
        if key not in self.known:
            self.known[key] = self.make().solve(problem, *start)
        return self.known[key]


@pytest.mark.parametrize("confidence", rest_is_long([0.95, 0.8], 1))
@pytest.mark.long
def test_sampled_bound_holds_as_often_as_it_claims(confidence: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Against the bound of all tiles, over 200 draws of 6 among 36; with a standard error of 2 to 3 %."""
    monkeypatch.setattr("inkloop_controller.program.certificate.HorizonProgram", Remembering)
    problem = rough((12, 12), 2)
    plan = searched(problem)
    whole = certify(problem, plan, whole_max=0, tile=2, tiles_max=36).bound
    bounds = [
        certify(problem, plan, whole_max=0, tile=2, tiles_max=6, seed=seed, confidence=confidence).bound
        for seed in range(200)
    ]
    assert abs(np.mean(np.array(bounds) <= whole) - confidence) < 0.08


@pytest.mark.parametrize("confidence", [0.5, 0.9])
@pytest.mark.parametrize("seed", [0, 3])
def test_sampled_bound_lacks_the_gaps_of_the_tiles_and_what_others_may_have_more(seed: int, confidence: float) -> None:
    """A surface 5 um too high: the best plan is none, and the gap of a tile is what falls on it."""
    plain, part = rough((10, 10), 1), np.ones((10, 10), np.bool_)
    part[9] = False
    plan = (np.random.default_rng(2).random((1, 10, 10)) < np.linspace(0.0, 0.5, 10)).astype(np.int32)
    problem = replace(plain, target=plain.height - 5e-6, part=part)
    fallen = np.where(part, bindings.layer(plain.height, plan[0], plain.kinds) - plain.height, 0.0)
    gaps = np.array([fallen[i : i + 4, j : j + 4].sum() for i in (0, 4, 8) for j in (0, 4, 8)])
    drawn = gaps[np.random.default_rng(seed).permutation(9)[:5]]
    error = drawn.std(ddof=1) / np.sqrt(5) * np.sqrt(1 - 5 / 9)
    excess = drawn.mean() + t.ppf(confidence, 4) * error
    found = certify(problem, plan, whole_max=0, tile=4, tiles_max=5, seed=seed, confidence=confidence)
    assert found.objective == pytest.approx(5e-6 + fallen.sum() / 90, rel=1e-9, abs=0.0)
    assert found.bound == pytest.approx(found.objective - 9 * excess / 90, rel=1e-5, abs=0.0)


def test_certificate_without_time_proves_nothing() -> None:
    problem = rough((20, 20), 1)
    plan = searched(problem)
    for options in ({}, {"whole_max": 399, "tile": 10}, {"whole_max": 399, "tile": 5, "tiles_max": 2}):
        found = certify(problem, plan, seconds_max=0.0, **options)
        assert found.tiles_proven == 0
        assert found.bound == pytest.approx(0.0, abs=1e-15)
        assert found.bound >= 0.0


@pytest.mark.parametrize(("whole_max", "tiles"), [(25, 1), (24, 4)])
def test_grid_of_more_cells_than_a_program_takes_falls_into_tiles(whole_max: int, tiles: int) -> None:
    problem, _ = small()
    found = certify(problem, np.zeros((1, 5, 5), np.int32), seconds_max=0.0, whole_max=whole_max, tile=3)
    assert (found.tiles, found.tiles_solved) == (tiles, tiles)


def test_more_confidence_asks_for_a_lower_bound() -> None:
    problem = rough((10, 10), 1)
    plan = searched(problem)
    bounds = [
        certify(problem, plan, whole_max=0, tile=4, tiles_max=5, confidence=confidence).bound
        for confidence in (0.5, 0.9, 0.99)
    ]
    assert bounds[0] > bounds[1] > bounds[2]


def test_worse_plan_has_a_larger_gap_and_no_lower_bound() -> None:
    problem, good = small()
    bad = certify(problem, np.ones((1, 5, 5), np.int32))
    assert bad.gap > good.gap
    assert bad.bound == pytest.approx(good.bound, rel=1e-3, abs=0.0)


def test_problems_that_are_not_linear_are_refused() -> None:
    problem = rough((4, 4))
    plan = np.zeros((1, 4, 4), np.int32)
    for other in (replace(problem, alpha=0.8), replace(problem, colours=((0, 1, 2, 3),))):
        with pytest.raises(ValueError, match="needs 1 layer of 1 pass and alpha = 1"):
            certify(other, plan)
    with pytest.raises(ValueError, match="at most 1 kind on each cell"):
        certify(replace(problem, kinds=(Ink(), Ink()), choices=np.full((1, 4, 4), 3, np.uint16)), plan)
    with pytest.raises(ValueError, match="tiles_max 1"):
        certify(problem, plan, tiles_max=1)
    for wrong in ({"confidence": 1.0}, {"confidence": 0.49}, {"tile": 0}):
        with pytest.raises(ValueError, match=r"needs a confidence from 0.5 to below 1, .* tiles of at least 1 cell"):
            certify(problem, plan, **wrong)


@pytest.mark.parametrize(("objective", "bound", "gap"), [(4e-6, 3e-6, 0.25), (0.0, 0.0, 0.0)])
def test_gap_is_a_share_of_the_objective(objective: float, bound: float, gap: float) -> None:
    assert Certificate(objective, bound, 1.0, 1, 1, 1, 0.0).gap == pytest.approx(gap, rel=1e-12, abs=0.0)


@pytest.mark.parametrize(("fringe", "tiles"), [(0.3, 2), (0.0, 1)])
def test_tile_counts_where_a_cell_has_a_weight(fringe: float, tiles: int) -> None:
    """Also beside the part."""
    columns = np.broadcast_to(np.arange(6), (3, 6))
    part, weight = columns < 3, np.where(columns < 3, 1.0, np.where(columns == 3, fringe, 0.0))
    problem = replace(rough((3, 6)), part=part, weight=weight, choices=part[None].astype(np.uint16))
    found = certify(problem, np.zeros((1, 3, 6), np.int32), whole_max=0, tile=3)
    assert (found.tiles, found.tiles_solved, found.tiles_proven) == (tiles, tiles, tiles)
