"""Invariants of the search core."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from inkloop.component import Ink
from inkloop_controller.core import bindings
from inkloop_controller.core.library import CORE_NO_MEMORY, ReportStruct
from inkloop_controller.problem.arrays import error_of_array
from inkloop_controller.problem.horizon_problem import HorizonProblem, SearchProgress
from support.core_search import Moves, SearchStatus, search
from support.long_proofs import rest_is_long

INK = Ink()
ONE_MICROMETRE = 1e-6


def problem(height: Any, target: Any, alpha: float = 1.0, *, layers: int = 1, **fields: Any) -> HorizonProblem:
    kinds = fields.pop("kinds", (INK,))
    choices = np.full((layers, *height.shape), (2 ** len(kinds) - 1) % 2**16, np.uint16)
    values = {"part": np.ones(height.shape, np.bool_), "choices": choices, "kinds": kinds, **fields}
    return HorizonProblem(height=height, target=target, alpha=alpha, **values)


def rough(seed: int, nx: int = 20, ny: int = 0) -> tuple[Any, Any]:
    """A rough surface, a square without ny, and a flat target that no pattern reaches exactly."""
    height = np.random.default_rng(seed).uniform(0.0, 8e-6, (nx, ny or nx))
    return height, np.full(height.shape, height.mean() + 3.8e-6)


def everything(nx: int = 20, layers: int = 1, ny: int = 0) -> Any:
    return np.ones((layers, nx, ny or nx), np.int32)


def printed(height: Any, plan: Any, kinds: tuple[Ink, ...] = (INK,), orders: Any = ()) -> Any:
    """Surface after all layers of a plan, by the layer map: one kind of droplet after the other on the same surface."""
    for number, layer in enumerate(plan):
        for colours in [[colour] for colour in orders[number]] if orders else [range(4)]:
            i, j = np.indices(height.shape)
            jetted = np.where(np.isin(2 * (i % 2) + j % 2, list(colours)), layer, 0)
            added = [
                bindings.layer(height, (jetted == 1 + k).astype(np.int32), (kind,)) - height
                for k, kind in enumerate(kinds)
            ]
            height = height + sum(added)
    return height


def value(wanted: HorizonProblem, plan: Any) -> float:
    return bindings.objective(wanted, plan).value


@pytest.mark.parametrize("whose", ["ours", "paper's"])
def test_pattern_that_made_a_surface_is_recovered(whose: str) -> None:
    """The test of Lu, Zheng, Mishra (2015, IV-C): 50 of 50."""
    for seed in range(50):
        rng = np.random.default_rng(seed)
        height = rng.uniform(0.0, 8e-6, (20, 20))
        plan = rng.integers(0, 2, (1, 20, 20), dtype=np.int32)
        wanted = problem(height, printed(height, plan))
        found: Any = (
            search(wanted, everything(), sweeps_max=50)
            if whose == "ours"
            else bindings.paper_search(wanted, everything(), 20, 100_000, seed)
        )
        np.testing.assert_array_equal(found.plan, plan)
        assert found.objective.value < 1e-9 * ONE_MICROMETRE


@pytest.mark.parametrize("alpha", [0.0, 0.3, 0.8, 1.0])
def test_running_sums_do_not_drift(alpha: float) -> None:
    height, target = rough(1, 40)
    for offset in (0.0, 1e-2):  # 10 mm above the substrate, squares would cancel without a reference height
        found = search(
            problem(height + offset, target + offset, alpha), everything(40), sweeps_max=200, annealing_sweeps=200
        )
        assert found.flips > 3000
        assert found.incremental == pytest.approx(found.objective.value, rel=1e-9, abs=0.0)


@pytest.mark.parametrize("layers", [1, 2, 3])
@pytest.mark.parametrize("alpha", [0.7, 1.0])
@pytest.mark.parametrize(("seed", "nx", "ny"), [(2, 7, 7), (7, 7, 7), (20, 7, 7), (2, 4, 11), (2, 11, 4)])
def test_finished_search_leaves_no_move_that_helps(seed: int, nx: int, ny: int, layers: int, alpha: float) -> None:
    """With seeds 7 and 20 also where moves begin to help that were tried in vain before."""
    height, target = rough(seed, nx, ny)
    wanted = problem(height, target, alpha, layers=layers)
    found = search(wanted, everything(nx, layers, ny), sweeps_max=500)
    assert found.status is SearchStatus.DONE
    for changed in [*flips(found.plan), *swaps(found.plan), *shifts(found.plan)]:
        assert value(wanted, changed) > found.objective.value - 1e-8 * ONE_MICROMETRE / 81


def flips(plan: Any) -> list[Any]:
    changes = []
    for cell in range(plan.size):
        changed = plan.copy()
        changed.flat[cell] = 1 - changed.flat[cell]
        changes.append(changed)
    return changes


def swaps(plan: Any) -> list[Any]:
    _, nx, ny = plan.shape
    changes = []
    for layer, i, j in np.argwhere(plan):
        for k, m in np.ndindex(3, 3):
            place = (layer, i + k - 1, j + m - 1)
            if 0 <= place[1] < nx and 0 <= place[2] < ny and not plan[place]:
                changed = plan.copy()
                changed[layer, i, j], changed[place] = 0, 1
                changes.append(changed)
    return changes


def shifts(plan: Any) -> list[Any]:
    changes = []
    for layer, i, j in np.argwhere(plan):
        for other in np.flatnonzero(plan[:, i, j] == 0):
            changed = plan.copy()
            changed[layer, i, j], changed[other, i, j] = 0, 1
            changes.append(changed)
    return changes


@pytest.mark.parametrize("layers", [1, 3])
def test_finished_paper_search_leaves_no_flip_that_helps(layers: int) -> None:
    height, target = rough(3, 9)
    wanted = problem(height, target + (layers - 1) * 7.6e-6, 0.7, layers=layers)
    found = bindings.paper_search(wanted, everything(9, layers), 20, 100_000, 1)
    assert found.is_done
    assert found.progress.swaps == 0
    assert found.objective.value == pytest.approx(value(wanted, found.plan), rel=1e-9, abs=0.0)
    assert found.progress.evaluations == found.progress.sweeps * layers * 81, "a pass draws every cell of every layer"
    for changed in flips(found.plan):
        assert value(wanted, changed) > found.objective.value - 1e-8 * ONE_MICROMETRE / 81


def test_batch_of_flips_never_raises_the_objective() -> None:
    """On a flat surface that wants half a layer each flip alone helps, and all together do harm."""
    height = np.zeros((12, 12))
    wanted = problem(height, np.full((12, 12), 3.8e-6))
    values = [
        bindings.paper_search(wanted, everything(12), 144, batches, 7).objective.value
        for batches in (1, 2, 3, 5, 9, 17, 33, 100)
    ]
    assert values == sorted(values, reverse=True)
    assert values[-1] < value(wanted, everything(12))
    found = bindings.paper_search(wanted, everything(12), 144, 2, 7)
    assert found.progress.evaluations == 144 + 72, "then half of them"


def searched_as_published(wanted: HorizonProblem, plan: Any, batch: int, seed: int) -> tuple[Any, int, int, int]:
    """The plan, and how often the places were gone through, flips tried and flips made (Lu, Zheng, Mishra 2015)."""
    plan, draws, passes, tried, made = plan.copy(), 0, 0, 0, 0
    order = np.flatnonzero(wanted.choices)
    improved = True
    while improved:
        improved = False
        passes += 1
        for left in range(len(order), 1, -1):
            picked = drawn(seed, draws) % left
            draws += 1
            order[[picked, left - 1]] = order[[left - 1, picked]]
        first = 0
        while first < len(order):
            places, now = order[first : first + batch], value(wanted, plan)
            first += len(places)
            tried += len(places)
            marked = [place for place in places if value(wanted, flipped(plan, [place])) < now - 1e-15]
            improved = improved or bool(marked)
            together = flipped(plan, marked)
            if len(marked) == 1 or value(wanted, together) < now:
                plan, made = together, made + len(marked)
            elif marked:
                batch = max(1, batch // 2)
    return plan, passes, tried, made


def flipped(plan: Any, places: Any) -> Any:
    changed = plan.copy()
    changed.flat[places] = 1 - changed.flat[places]
    return changed


@pytest.mark.parametrize(("layers", "alpha", "batch"), [(1, 1.0, 20), (1, 0.5, 7), (2, 0.7, 16)])
def test_papers_search_goes_through_the_places_as_published(layers: int, alpha: float, batch: int) -> None:
    """Places where nothing may fall are no places."""
    height, target = rough(9, 6, 9)
    choices = (np.random.default_rng(9).random((layers, 6, 9)) < 0.8).astype(np.uint16)
    wanted = problem(height, target + (layers - 1) * 7.6e-6, alpha, layers=layers, choices=choices)
    start = np.zeros((layers, 6, 9), np.int32)
    found = bindings.paper_search(wanted, start, batch, 100_000, 5)
    plan, passes, tried, made = searched_as_published(wanted, start, batch, 5)
    np.testing.assert_array_equal(found.plan, plan)
    assert (found.progress.sweeps, found.progress.evaluations, found.progress.flips) == (passes, tried, made)


def test_droplet_may_stay_on_its_cell() -> None:
    wanted = problem(np.zeros((20, 20)), np.full((20, 20), 4e-6), kinds=(Ink(4e-6, 0.0, 0.0),))
    assert value(wanted, everything()) == pytest.approx(0.0, abs=1e-15)


def test_every_cell_is_equally_often_the_first_of_the_papers_search() -> None:
    """The one flip of a batch of one shows it; each flip helps here."""
    wanted, first = problem(np.zeros((3, 3)), np.zeros((3, 3))), np.zeros((3, 3))
    for seed in range(900):
        found = bindings.paper_search(wanted, everything(3), 1, 1, seed)
        assert found.plan.sum() == 8
        first += 1 - found.plan[0]
    assert first.min() > 65  # 100 on average, 9.4 more or less
    assert first.max() < 135


def test_work_budget_is_kept() -> None:
    height, target = rough(4)
    found = search(problem(height, target), everything(), sweeps_max=2)
    assert found.status is SearchStatus.BUDGET
    assert found.sweeps == 2
    greedy = bindings.paper_search(problem(height, target), everything(), 10, 3, 0)
    assert not greedy.is_done
    assert greedy.progress.evaluations == 30


@pytest.mark.parametrize("threads", [2, 3])
@pytest.mark.parametrize(
    ("shape", "layers", "passes", "alpha"), [((150, 70), 2, 1, 1.0), ((65, 200), 1, 4, 0.6), ((20, 180), 2, 1, 0.8)]
)
def test_any_number_of_threads_gives_the_same_bits(
    threads: int, shape: tuple[int, int], layers: int, passes: int, alpha: float
) -> None:
    """Also on grids that are no multiple of a tile."""
    height = np.random.default_rng(8).uniform(0.0, 8e-6, shape)
    colours = ((0, 3, 1, 2),) * layers if passes == 4 else ()
    wanted = problem(height, np.full(shape, height.mean() + 4.5e-6 * layers), alpha, layers=layers, colours=colours)
    start = np.zeros((layers, *shape), np.int32)
    one, many = (search(wanted, start, sweeps_max=12, annealing_sweeps=2, threads=number) for number in (1, threads))
    assert {**vars(one), "plan": None} == {**vars(many), "plan": None}
    np.testing.assert_array_equal(one.plan, many.plan)


def test_tiles_side_by_side_never_raise_the_objective() -> None:
    """The standard deviation is no sum over tiles. Of two tiles of one colour the higher one gains by giving up its
    droplets, the lower one by taking some; both together would change places, and end further apart than before."""
    height = np.zeros((192, 64))
    height[128:] = -3.8e-6
    part = np.ones(height.shape, np.bool_)
    part[64:128] = False
    choices = part[None].astype(np.uint16)
    wanted = problem(height, np.zeros(height.shape), 0.0, part=part, choices=choices)
    start = np.zeros((1, *height.shape), np.int32)
    start[0, 128:] = 1
    values = [value(wanted, start)]
    search(wanted, start, sweeps_max=20, after_sweep=lambda progress: values.append(progress.value) or False)
    assert len(values) > 3
    assert values == sorted(values, reverse=True)
    assert values[-1] < 0.7 * values[0]

    annealed_once: list[float] = []
    search(
        wanted,
        start,
        sweeps_max=0,
        annealing_sweeps=1,
        after_sweep=lambda progress: annealed_once.append(progress.value) or False,
    )
    assert annealed_once[0] > 1.02 * values[0], "annealing may raise it: no tile is taken back"


@pytest.mark.parametrize("orders", [(), ((0, 3, 1, 2), (2, 1, 3, 0))])
def test_objective_is_that_of_all_layers_and_passes(orders: Any) -> None:
    height, target = rough(9, 12)
    kinds = (INK, Ink(3.9e-6, 0.55e-6, 0.15e-6), Ink(8.8e-6, 1.2e-6, 0.4e-6))
    weight = np.random.default_rng(9).uniform(0.0, 1.0, height.shape)
    ceiling = target + 10e-6
    costs: dict[str, Any] = {"weight": weight, "overshoot": 3.0, "ceiling": ceiling, "ceiling_cost": 50.0}
    wanted = problem(height, target, 0.6, layers=2, kinds=kinds, colours=orders, **costs)
    plan = np.random.default_rng(1).integers(0, 4, (2, 12, 12), dtype=np.int32)
    after = printed(height, plan, kinds, orders)
    found = bindings.objective(wanted, plan)
    below, above = np.maximum(target - after, 0.0), np.maximum(after - target, 0.0)
    assert found.error == pytest.approx((weight * (below + 3.0 * above)).mean(), rel=1e-9, abs=0.0)
    assert found.over_ceiling == pytest.approx(
        50.0 * (weight * np.maximum(after - ceiling, 0.0)).mean(), rel=1e-9, abs=0.0
    )
    assert found.over_ceiling > 0.0
    assert found.deviation == pytest.approx(after.std(), rel=1e-9, abs=0.0)
    assert found.value == pytest.approx(
        0.6 * (found.error + found.over_ceiling) + 0.4 * found.deviation, rel=1e-12, abs=0.0
    )


@pytest.mark.parametrize(
    ("seed", "nx", "ny", "alpha", "layers"),
    [(14, 70, 66, 1.0, 1), (1, 400, 12, 1.0, 1), (2, 70, 66, 0.7, 1), (4, 70, 66, 1.0, 2), (5, 70, 66, 0.2, 2)],
)
def test_finished_search_leaves_nothing_to_another_one(seed: int, nx: int, ny: int, alpha: float, layers: int) -> None:
    """On grids of several tiles, with and without the standard deviation, which every change alters everywhere."""
    height, target = rough(seed, nx, ny)
    wanted = problem(height, target + (layers - 1) * 7.6e-6, alpha, layers=layers)
    found = search(wanted, everything(nx, layers, ny), sweeps_max=1000)
    again = search(wanted, found.plan, sweeps_max=1000)
    assert found.status is again.status is SearchStatus.DONE
    assert (again.flips, again.swaps, again.shifts) == (0, 0, 0)


WORD = 2**64


def mixed(word: int) -> int:
    """The finaliser of SplitMix64 (Steele, Lea, Flood 2014)."""
    word = (word ^ word >> 30) * 0xBF58476D1CE4E5B9 % WORD
    word = (word ^ word >> 27) * 0x94D049BB133111EB % WORD
    return word ^ word >> 31


def drawn(key: int, counter: int) -> int:
    return mixed((mixed(key) + (counter + 1) * 0x9E3779B97F4A7C15) % WORD)


def annealed(wanted: HorizonProblem, plan: Any, sweeps: int, seed: int) -> tuple[list[float], list[int]]:
    """Objective after each sweep of Metropolis's rule, and proposals, flips and shifts; temperatures fall from 0.2 to
    0.01 of the worth of the tallest droplet."""
    plan, values, counts = plan.copy(), [], [0, 0, 0]
    layers, nx, ny = plan.shape
    worth = max(kind.h1 for kind in wanted.kinds) / wanted.part.sum()
    now = value(wanted, plan)
    for sweep in range(sweeps):
        temperature = worth * (0.2 * 0.05 ** (sweep / (sweeps - 1)) if sweeps > 1 else 0.01)
        key = drawn(seed, sweep)
        for i, j, above in np.ndindex(nx, ny, layers):
            layer = layers - 1 - above
            first = 3 * ((layer * nx + i) * ny + j)
            own, changed = plan[layer, i, j], plan.copy()
            is_shift = layers > 1 and drawn(key, first) >> 11 < 2**52
            if is_shift:
                other = (layer + 1 + drawn(key, first + 1) % (layers - 1)) % layers
                changed[[layer, other], i, j] = plan[[other, layer], i, j]
            else:
                allowed = [0, *(1 + k for k in range(len(wanted.kinds)) if wanted.choices[layer, i, j] >> k & 1)]
                others = [one for one in allowed if one != own]
                changed[layer, i, j] = others[drawn(key, first + 1) % len(others)] if others else own
            allows = (2 * wanted.choices[:, i, j].astype(int) + 1) >> changed[:, i, j] & 1
            if (changed == plan).all() or not allows.all():
                continue
            counts[0] += 1
            after = value(wanted, changed)
            if after < now or (drawn(key, first + 2) >> 11) * 2.0**-53 < np.exp((now - after) / temperature):
                plan, now = changed, after
                counts[1 + is_shift] += 1
        values.append(now)
    return values, counts


@pytest.mark.parametrize(("sweeps", "layers", "alpha"), [(1, 2, 1.0), (6, 1, 1.0), (6, 1, 0.6), (8, 3, 0.6)])
def test_annealing_takes_each_change_by_the_rule_of_metropolis(sweeps: int, layers: int, alpha: float) -> None:
    height, target = rough(6, 5, 7)
    kinds = (INK, Ink(8.8e-6, 1.2e-6, 0.4e-6), Ink(3.9e-6, 0.55e-6, 0.15e-6))
    choices = np.random.default_rng(6).integers(0, 8, (layers, 5, 7)).astype(np.uint16)
    wanted = problem(height, target + (layers - 1) * 4e-6, alpha, layers=layers, kinds=kinds, choices=choices)
    start = np.zeros((layers, 5, 7), np.int32)
    values: list[float] = []
    found = search(
        wanted,
        start,
        sweeps_max=0,
        annealing_sweeps=sweeps,
        seed=11,
        after_sweep=lambda progress: values.append(progress.value) or False,
    )
    expected, counts = annealed(wanted, start, sweeps, 11)
    assert values == pytest.approx(expected, rel=1e-9, abs=0.0)
    assert [found.evaluations, found.flips, found.shifts] == counts
    assert found.incremental == pytest.approx(found.objective.value, rel=1e-9, abs=0.0)
    assert found.objective.value == pytest.approx(min([*expected, value(wanted, start)]), rel=1e-9, abs=0.0)


@pytest.mark.parametrize("below", [0.0, 50e-6, -50e-6])
def test_surface_of_several_layers_is_that_of_the_layer_map_wherever_heights_begin(below: float) -> None:
    """Droplets spill over the edges of the grid, also of surfaces below 0."""
    height, target = (each - below for each in rough(3, 5, 7))
    plan = np.random.default_rng(3).integers(0, 2, (3, 5, 7), np.int32)
    left = printed(height, plan)
    wanted = problem(height, left, layers=3, overshoot=1.0)
    assert value(wanted, plan) == pytest.approx(0.0, abs=1e-15)
    assert value(replace(wanted, target=target), plan) == pytest.approx(np.abs(left - target).mean(), rel=1e-9, abs=0.0)


def test_two_layers_that_made_a_surface_are_recovered() -> None:
    """Droplets that fell in the wrong layer together are what descent alone leaves: annealing shifts them."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        height = rng.uniform(0.0, 5e-6, (20, 20))
        wanted = problem(height, printed(height, rng.integers(0, 2, (2, 20, 20), dtype=np.int32)), layers=2)
        found = search(wanted, everything(layers=2), sweeps_max=200, annealing_sweeps=100, seed=1)
        assert found.objective.value < 1e-9 * ONE_MICROMETRE


@pytest.mark.parametrize("alpha", rest_is_long([0.5, 1.0], 1))
def test_two_layers_of_a_few_cells_are_as_good_as_they_can_be(alpha: float) -> None:
    """Against every plan of 2 x 3 cells in 2 layers."""
    for seed in range(6):
        height = np.random.default_rng(seed).uniform(0.0, 8e-6, (2, 3))
        wanted = problem(height, np.full((2, 3), height.mean() + 7.6e-6), alpha, layers=2)
        plans = (np.arange(2**12)[:, None] >> np.arange(12)) & 1
        least = min(value(wanted, plan.astype(np.int32).reshape(2, 2, 3)) for plan in plans)
        found = search(wanted, np.zeros((2, 2, 3), np.int32), sweeps_max=200, annealing_sweeps=500, seed=2)
        assert found.objective.value == pytest.approx(least, rel=1e-9, abs=0.0)


def test_what_falls_next_to_the_part_costs_nothing() -> None:
    height, target = rough(7)
    part = np.zeros((20, 20), np.bool_)
    part[5:15, 5:15] = True
    near, far = target.copy(), target.copy()
    far[~part] = 0.1
    left, right = (
        search(
            problem(height, there, 0.8, part=part, choices=part.astype(np.uint16)[None]),
            part.astype(np.int32)[None],
            sweeps_max=100,
        )
        for there in (near, far)
    )
    np.testing.assert_array_equal(left.plan, right.plan)
    assert left.objective == right.objective


def test_search_without_any_time_or_work_returns_its_start() -> None:
    height, target = rough(11)
    budget: dict[str, Any]
    for budget, status in (({"seconds_max": 0.0}, SearchStatus.TIME), ({"sweeps_max": 0}, SearchStatus.BUDGET)):
        found = search(problem(height, target), everything(), **({"sweeps_max": 9} | budget))
        assert found.status is status
        np.testing.assert_array_equal(found.plan, everything())


def test_annealing_that_is_stopped_returns_the_best_plan_so_far() -> None:
    height, target = rough(12)
    wanted = problem(height, target)
    start = search(wanted, everything(), sweeps_max=100)
    values: list[float] = []

    def after_sweep(progress: SearchProgress) -> bool:
        values.append(progress.value)
        return len(values) == 3

    found = search(wanted, start.plan, sweeps_max=100, annealing_sweeps=50, after_sweep=after_sweep)
    assert min(values) > start.objective.value, "hot"
    np.testing.assert_array_equal(found.plan, start.plan)
    assert found.incremental == found.objective.value == start.objective.value


def test_only_the_moves_asked_for_are_made() -> None:
    height, target = rough(15)
    start = (np.arange(800).reshape(2, 20, 20) % 3 > 0).astype(np.int32)
    wanted = problem(height, target + 6.3e-6, layers=2)
    for moves in (Moves.FLIPS, Moves.SWAPS, Moves.SHIFTS):
        found = search(wanted, start, sweeps_max=100, moves=moves)
        made = {Moves.FLIPS: found.flips, Moves.SWAPS: found.swaps, Moves.SHIFTS: found.shifts}
        assert [move for move in made if made[move]] == [moves]


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"target": np.zeros((3, 4))}, r"target has shape \(3, 4\); needs \(4, 4\)"),
        ({"height": np.full((4, 4), np.nan)}, r"height is nan at cell \(0, 0\)"),
        (
            {"height": np.zeros((4,)), "choices": np.zeros((1, 4), np.uint16)},
            r"height has shape \(4,\); a layer problem",
        ),
        ({"height": np.zeros((4, 0)), "target": np.zeros((4, 0))}, r"shape \(4, 0\); .* with at least one cell"),
        ({"height": np.full((4, 4), -0.7)}, "height reaches 0.7 m with 1 layers to come; needs heights within 0.5 m"),
        ({"target": np.full((4, 4), 0.7)}, "target reaches 0.7 m"),
        ({"ceiling": np.full((4, 4), 0.7)}, "ceiling reaches 0.7 m"),
        (
            {"height": np.full((4, 4), 0.47), "kinds": (Ink(), Ink(6e-3, 5e-4, 5e-4)), "layers": 2},
            "height reaches 0.47 m with 2 layers to come; needs heights within 0.46 m",
        ),
        ({"height": np.full((4, 4), 0.7)}, "height reaches 0.7 m"),
        ({"choices": np.zeros((1, 4, 4))}, "choices has dtype float64; needs uint16"),
        ({"choices": np.zeros((0, 4, 4), np.uint16)}, "horizon of 1 to 5"),
        ({"choices": np.zeros((6, 4, 4), np.uint16)}, "choices holds 6 layers; needs a horizon of 1 to 5"),
        ({"choices": np.full((1, 4, 4), 2, np.uint16)}, r"layer 0 is 2 at cell \(0, 0\); needs bits of the 1 kinds"),
        (
            {
                "choices": np.array([[[1, 0]] * 2, [[1, 5]] * 2], np.uint16),
                "kinds": (INK, INK),
                **dict.fromkeys(("height", "target"), np.zeros((2, 2))),
            },
            r"choices of layer 1 is 5 at cell \(0, 1\); needs bits of the 2 kinds given",
        ),
        ({"kinds": (), "choices": np.zeros((1, 4, 4), np.uint16)}, "kinds holds 0 kinds"),
        ({"kinds": (INK,) * 17, "choices": np.ones((1, 4, 4), np.uint16)}, "kinds holds 17 kinds of .* needs 1 to 16"),
        ({"kinds": (Ink(0.0, 1e-6, 0.0),)}, "kind 0 is .*; needs h1 > 0"),
        ({"kinds": (Ink(4e-6, 1e-6, np.inf),)}, "kind 0 is .*; needs h1 > 0"),
        ({"kinds": (Ink(4.4e-6, -1e-6, 0.0),)}, "kind 0 is .* neither h2 nor h3 below 0"),
        ({"part": np.zeros((4, 4), np.bool_)}, "part marks no cell"),
        ({"alpha": 1.5}, "alpha is 1.5; needs a weight between 0 and 1"),
        ({"alpha": np.nan, "overshoot": 0.0}, "alpha is nan.*; overshoot is 0.0; needs a cost above 0"),
        ({"weight": np.full((4, 4), -1.0)}, r"weight is -1.0 at cell \(0, 0\)"),
        ({"ceiling": np.full((4, 4), np.inf)}, r"ceiling is inf at cell \(0, 0\)"),
        ({"weight": np.full((3, 4), 1.0)}, r"weight has shape \(3, 4\)"),
        ({"ceiling_cost": -1.0}, "ceiling_cost is -1.0"),
        ({"ceiling_cost": np.inf}, "ceiling_cost is inf"),
        ({"overshoot": np.inf}, "overshoot is inf"),
        ({"droplet_std": -0.1}, "droplet_std is -0.1; needs a share of a droplet of at least 0"),
        ({"droplet_std": np.inf}, "droplet_std is inf"),
        ({"colours": ((0, 1, 2, 3),), "layers": 2}, "for each of 2 layers the colours 0 to 3 once"),
        ({"colours": ((0, 1, 2, 2),)}, "for each of 1 layers the colours 0 to 3 once"),
    ],
)
def test_invalid_problem_is_refused(fields: dict[str, Any], message: str) -> None:
    whole = {"height": np.zeros((4, 4)), "target": np.zeros((4, 4)), **fields}
    with pytest.raises(ValueError, match=message):
        problem(**whole)


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        (np.ones((1, 2, 2), np.int32), r"kind 0 at cell \(0, 1\) of layer 0, where the choices do not allow it"),
        (np.full((1, 2, 2), 2, np.int32), "plan holds 2 to 2; needs 0 to 1"),
        (np.full((1, 2, 2), -1, np.int32), "plan holds -1 to -1; needs 0 to 1"),
        (np.zeros((2, 2, 2), np.int32), r"plan has shape \(2, 2, 2\); needs \(1, 2, 2\)"),
    ],
)
def test_plan_that_cannot_be_printed_is_refused(plan: Any, message: str) -> None:
    choices = np.array([[[1, 0], [1, 1]]], np.uint16)
    with pytest.raises(ValueError, match=message):
        search(problem(np.zeros((2, 2)), np.zeros((2, 2)), choices=choices), plan, sweeps_max=10)


def test_papers_search_is_for_one_kind() -> None:
    with pytest.raises(ValueError, match="up to 2 kinds on a cell; the paper's search needs at most 1"):
        bindings.paper_search(problem(*rough(0), kinds=(INK, INK)), everything(), 20, 100, 0)


@pytest.mark.parametrize(("batch", "seed"), [(0, 1), (1, -1)])
def test_batch_without_cells_and_negative_seed_are_refused(batch: int, seed: int) -> None:
    message = f"batch is {batch} and seed {seed}; needs a batch of at least 1 cell and a seed >= 0"
    with pytest.raises(ValueError, match=message):
        bindings.paper_search(problem(*rough(0)), everything(), batch, 100, seed)


@pytest.mark.parametrize("order", [(0, 1, 2), (0, 1, 2, 2), (1, 2, 3, 4)])
def test_passes_that_are_not_the_four_colours_are_refused(order: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"order is .*; needs each of the colours 0 to 3 once"):
        bindings.layer(np.zeros((2, 3)), np.zeros((2, 3), np.int32), (INK,), order)
    with pytest.raises(ValueError, match="pattern holds -1 to -1; needs 0 to 1"):
        bindings.layer(np.zeros((2, 3)), np.full((2, 3), -1, np.int32), (INK,))


def test_arrays_in_any_order_or_read_only_and_of_any_size_of_number_are_the_same_problem() -> None:
    """In memory that C cannot take as it is."""
    height, target = rough(5, 6, 9)
    straight = problem(height, target, 0.7, layers=2)
    given: dict[str, Any] = {
        name: np.asfortranarray(getattr(straight, name)) for name in ("height", "target", "part", "choices")
    }
    for array in given.values():
        array.flags.writeable = False
    plan = everything(6, 2, 9)
    plan[0, 1:3, 4:] = 0
    turned = replace(straight, **given)
    assert value(turned, np.asfortranarray(plan)) == value(straight, plan)
    before = value(straight, plan)
    for array in (straight.height, straight.target, straight.part, straight.choices):
        array.flags.writeable = False
    assert value(straight, plan) == before
    assert not error_of_array("x", np.full((2, 2), 1e308), "f8", (2, 2))
    assert error_of_array("x", np.array([[1.0, np.inf], [-np.inf, 0.0]]), "f8", (2, 2))


def test_reports_of_a_search_name_what_was_done() -> None:
    report = ReportStruct(sweeps=2, evaluations=3, flips=4, swaps=5, shifts=6)
    report.objective.value = 7e-6
    assert bindings.progress_of(report) == SearchProgress(7e-6, 2, 3, 4, 5, 6)


def test_missing_memory_is_an_error_of_python() -> None:
    with pytest.raises(MemoryError, match="no memory for the search of a plan"):
        bindings.answered(CORE_NO_MEMORY)
