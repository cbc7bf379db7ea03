"""Laws of the search core."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inkloop.component import Ink
from inkloop_controller import core
from inkloop_controller.core import LayerProblem

INK = Ink()
ONE_MICROMETRE = 1e-6


def problem(height: Any, target: Any, alpha: float = 1.0, **fields: Any) -> LayerProblem:
    shape = height.shape
    values = {"part": np.ones(shape, np.bool_), "allowed": np.ones(shape, np.bool_), "inks": (INK,)}
    values |= {"material": np.zeros(shape, np.int32), **fields}
    return LayerProblem(height=height, target=target, alpha=alpha, **values)


def rough(seed: int, n: int = 20) -> tuple[Any, Any]:
    """A rough surface, and a flat target that no pattern reaches exactly."""
    height = np.random.default_rng(seed).uniform(0.0, 8e-6, (n, n))
    return height, np.full((n, n), height.mean() + 3.8e-6)


def everything(n: int = 20) -> Any:
    return np.ones((n, n), np.int32)


@pytest.mark.parametrize("search", ["ours", "paper's"])
def test_pattern_that_made_a_surface_is_recovered(search: str) -> None:
    """The test of Lu, Zheng, Mishra (2015, IV-C): 50 of 50."""
    for seed in range(50):
        rng = np.random.default_rng(seed)
        height = rng.uniform(0.0, 8e-6, (20, 20))
        pattern = rng.integers(0, 2, (20, 20), dtype=np.int32)
        wanted = problem(height, core.layer(height, pattern, (INK,)))
        if search == "ours":
            found = core.search(wanted, everything(), 50)
        else:
            found = core.paper_search(wanted, everything(), 20, 100_000, seed)
        np.testing.assert_array_equal(found.pattern, pattern)
        assert found.objective < 1e-9 * ONE_MICROMETRE


@pytest.mark.parametrize("alpha", [0.0, 0.3, 0.8, 1.0])
def test_running_sums_do_not_drift(alpha: float) -> None:
    height, target = rough(1, 40)
    for offset in (0.0, 1e-2):  # 10 mm above the substrate, squares would cancel without a reference height
        found = core.search(problem(height + offset, target + offset, alpha), everything(40), 200, annealing_sweeps=200)
        assert found.flips > 3000
        assert found.incremental == pytest.approx(found.objective, rel=1e-9 if offset == 0.0 else 1e-6)


def test_finished_search_leaves_no_flip_and_no_swap_that_helps() -> None:
    height, target = rough(2, 9)
    wanted = problem(height, target, 0.7)
    found = core.search(wanted, everything(9), 200)
    assert found.finished
    for changed in [*flips(found.pattern), *swaps(found.pattern)]:
        assert core.objective(wanted, changed) > found.objective - 1e-9 * ONE_MICROMETRE / 81


def flips(pattern: Any) -> list[Any]:
    changes = []
    for cell in range(pattern.size):
        changed = pattern.copy()
        changed.flat[cell] = 1 - changed.flat[cell]
        changes.append(changed)
    return changes


def swaps(pattern: Any) -> list[Any]:
    n = len(pattern)
    changes = []
    for i, j in np.argwhere(pattern):
        for k, m in np.ndindex(3, 3):
            place = (i + k - 1, j + m - 1)
            if 0 <= place[0] < n and 0 <= place[1] < n and not pattern[place]:
                changed = pattern.copy()
                changed[i, j], changed[place] = 0, 1
                changes.append(changed)
    return changes


def test_finished_paper_search_leaves_no_flip_that_helps() -> None:
    height, target = rough(3, 9)
    wanted = problem(height, target, 0.7)
    found = core.paper_search(wanted, everything(9), 20, 100_000, 1)
    assert found.finished
    assert found.swaps == 0
    for changed in flips(found.pattern):
        assert core.objective(wanted, changed) > found.objective - 1e-9 * ONE_MICROMETRE / 81


def test_batch_of_flips_never_raises_the_objective() -> None:
    """On a flat surface that wants half a layer each flip alone helps, and all together do harm."""
    height = np.zeros((12, 12))
    wanted = problem(height, np.full((12, 12), 3.8e-6))
    values = [
        core.paper_search(wanted, everything(12), 144, batches, 7).objective for batches in (1, 2, 3, 5, 9, 17, 33, 100)
    ]
    assert values == sorted(values, reverse=True)
    assert values[-1] < core.objective(wanted, everything(12))


def test_work_budget_is_kept() -> None:
    height, target = rough(4)
    found = core.search(problem(height, target), everything(), 2)
    assert not found.finished
    assert found.sweeps == 2
    greedy = core.paper_search(problem(height, target), everything(), 10, 3, 0)
    assert not greedy.finished
    assert greedy.evaluations == 30


def test_same_seed_gives_the_same_bits() -> None:
    height, target = rough(5)
    wanted = problem(height, target, 0.8)
    for repeat in (
        lambda: core.search(wanted, everything(), 50, annealing_sweeps=20, seed=3),
        lambda: core.paper_search(wanted, everything(), 20, 1000, 3),
    ):
        first, second = repeat(), repeat()
        np.testing.assert_array_equal(first.pattern, second.pattern)
        assert first.objective == second.objective


def test_droplets_fall_on_allowed_cells_only_and_are_of_the_cells_material() -> None:
    height, target = rough(6)
    allowed = np.indices((20, 20)).sum(axis=0) % 3 > 0
    material = (np.indices((20, 20))[0] > 9).astype(np.int32)
    inks = (INK, Ink(3.9e-6, 0.55e-6, 0.15e-6))
    wanted = problem(height, target, allowed=allowed, material=material, inks=inks)
    found = core.search(wanted, np.zeros((20, 20), np.int32), 100)
    assert set(np.unique(found.pattern[allowed & (material == 0)])) == {0, 1}
    assert set(np.unique(found.pattern[allowed & (material == 1)])) == {0, 2}
    assert not found.pattern[~allowed].any()


def test_what_falls_beside_the_part_costs_nothing() -> None:
    height, target = rough(7)
    part = np.zeros((20, 20), np.bool_)
    part[5:15, 5:15] = True
    near, far = target.copy(), target.copy()
    far[~part] = 1.0
    left, right = (
        core.search(problem(height, there, 0.8, part=part, allowed=part), part.astype(np.int32), 100)
        for there in (near, far)
    )
    np.testing.assert_array_equal(left.pattern, right.pattern)
    assert left.objective == right.objective


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"target": np.zeros((3, 4))}, r"target has shape \(3, 4\); needs \(4, 4\)"),
        ({"height": np.full((4, 4), np.nan)}, r"height is nan at cell \(0, 0\)"),
        ({"material": np.zeros((4, 4))}, "material has dtype float64; needs int32"),
        ({"material": np.ones((4, 4), np.int32)}, "1 or 2 inks and materials that name one"),
        ({"part": np.zeros((4, 4), np.bool_)}, "part marks no cell"),
        ({"alpha": 1.5}, "alpha is 1.5; needs a weight between 0 and 1"),
    ],
)
def test_problem_that_cannot_be_meant_is_refused(fields: dict[str, Any], words: str) -> None:
    whole = {"height": np.zeros((4, 4)), "target": np.zeros((4, 4)), **fields}
    with pytest.raises(ValueError, match=words):
        problem(**whole)


def test_pattern_off_the_allowed_cells_is_refused() -> None:
    wanted = problem(np.zeros((2, 2)), np.zeros((2, 2)), allowed=np.array([[True, False], [True, True]]))
    with pytest.raises(ValueError, match=r"droplet at cell \(0, 1\), where none is allowed"):
        core.search(wanted, np.ones((2, 2), np.int32), 10)
