"""The search for a plan of one layer alone, compared with a loop in Numba, in processor time."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from rich.console import Group
from rich.text import Text

from benchmarks.machine import arithmetic, bandwidths
from benchmarks.timing import scaled, table_of, timed
from inkloop.component import FloatMap, Ink
from inkloop.units import UM_PER_M
from inkloop_controller.core import bindings
from inkloop_controller.problem.horizon_problem import HorizonProblem, IntPlan, full_layers
from support.core_search import search

SIDES = (20, 500, 2048)
SWEEPS = 50  # at most
ROUNDS = 3
BYTES = 8 + 8 + 2 + 4
"""Of a cell that have to travel: height, target and what is allowed are read, the plan is written."""
OPERATIONS = 8 * 5 + 9 * 4
"""Of a cell, to try its flip once: shares of eight neighbours, costs of nine cells; a division counts as one."""
LEAST_GAIN = 1e-15  # [m], below which a change is rounding
INK = Ink()
SHARE = 0.6  # of a full layer, wanted on average on the nearly flat surface
LAYERS_BELOW = 20
VARIATION = 0.2

Search = Callable[[HorizonProblem], IntPlan]


def measure() -> Group:
    """Time per cell and objective, from full layers on."""
    searches: dict[str, Search] = {"inkloop": _ours} | ({"Numba": _numba()} if _has_numba() else {})
    copy, _ = bandwidths()
    floors = (BYTES / copy, OPERATIONS / arithmetic())
    columns = (f"{name}{what}" for name in searches for what in ("", ", um"))
    table = table_of(
        "plan of one layer by flips and swaps, alpha 1, processor time of one core, least of some",
        ("surface", *columns, "floor: memory", "arithmetic", "Numba / inkloop"),
    )
    for side in SIDES:
        for name, problem in (("rough", rough(side)), ("nearly flat", nearly_flat(side))):
            found = {each: _least(search, problem) for each, search in searches.items()}
            cells = [
                text
                for seconds, value in found.values()
                for text in (scaled(seconds / side**2), f"{value * UM_PER_M:.4f}")
            ]
            ratio = f"{found['Numba'][0] / found['inkloop'][0]:.1f}" if "Numba" in found else "-"
            table.add_row(f"{name} {side} x {side}", *cells, *(scaled(floor) for floor in floors), ratio)
    note = (
        f"floors: {BYTES} bytes per cell at the speed of a copy, {OPERATIONS} operations, one flip of each cell, at "
        "that of a product of matrices, both by NumPy"
    )
    return Group(table, Text(note))


def nearly_flat(side: int) -> HorizonProblem:
    """A printed surface, 20 full layers of varying droplets; 0.6 of a layer wanted."""
    rng = np.random.default_rng(0)
    height, full = np.zeros((side, side)), np.ones((side, side), np.int32)
    for _ in range(LAYERS_BELOW):
        height = bindings.layer(height, full, (INK,), factor=1.0 - VARIATION * rng.random(height.shape))
    return _problem(height, height.mean() + SHARE * INK.layer_height)


def rough(side: int) -> HorizonProblem:
    """A random surface of 0 to 8 um, half a layer wanted: no plan reaches it."""
    height = np.random.default_rng(0).uniform(0.0, 8e-6, (side, side))
    return _problem(height, height.mean() + INK.layer_height / 2)


def _problem(height: FloatMap, target: float) -> HorizonProblem:
    """One layer in one ink over all cells, alpha 1."""
    everywhere, choices = np.ones(height.shape, np.bool_), np.ones((1, *height.shape), np.uint16)
    return HorizonProblem(height, np.full_like(height, target), everywhere, choices, (INK,), 1.0)


def _ours(problem: HorizonProblem) -> IntPlan:
    return search(problem, full_layers(problem), sweeps_max=SWEEPS).plan


def _least(search: Search, problem: HorizonProblem) -> tuple[float, float]:
    """Processor time [s] and objective [m]."""
    found = [timed(partial(search, problem)) for _ in range(ROUNDS)]
    return min(each.processor_s for each in found), bindings.objective(problem, found[-1].answer).value


def _has_numba() -> bool:
    return importlib.util.find_spec("numba") is not None


def _numba() -> Search:
    """The same descent as one writes it in an afternoon."""
    from numba import njit

    @njit(cache=False)
    def change(before: Any, after: Any, target: Any, i: int, j: int, sign: float, made: bool, ink: Any) -> float:
        """Change of the cost by a droplet more or less on cell (i, j); done to the surface if it is to be made."""
        nx, ny = before.shape
        h1, h2, h3 = ink
        kept, cost = h1 + 4.0 * h2 + 4.0 * h3, 0.0
        for di in range(-1, 2):
            for dj in range(-1, 2):
                if di == 0 and dj == 0:
                    continue
                part, p, q = (h2 if di == 0 or dj == 0 else h3), i + di, j + dj
                if p < 0 or q < 0 or p >= nx or q >= ny:
                    kept -= part
                    continue
                share = part * min(1.0, max(0.0, 1.0 + (before[i, j] - before[p, q]) / (h1 + part)))
                kept -= share
                cost += abs(after[p, q] + sign * share - target[p, q]) - abs(after[p, q] - target[p, q])
                if made:
                    after[p, q] += sign * share
        cost += abs(after[i, j] + sign * kept - target[i, j]) - abs(after[i, j] - target[i, j])
        if made:
            after[i, j] += sign * kept
        return cost

    @njit(cache=False)
    def swap(before: Any, after: Any, target: Any, plan: Any, i: int, j: int, ink: Any) -> bool:
        """Moves the droplet of cell (i, j) to the first empty neighbour that is better; whether there is one."""
        nx, ny = before.shape
        removed = change(before, after, target, i, j, -1.0, True, ink)
        for p in range(max(0, i - 1), min(nx, i + 2)):
            for q in range(max(0, j - 1), min(ny, j + 2)):
                if plan[p, q] == 0 and removed + change(before, after, target, p, q, 1.0, False, ink) < -LEAST_GAIN:
                    change(before, after, target, p, q, 1.0, True, ink)
                    plan[i, j], plan[p, q] = 0, 1
                    return True
        change(before, after, target, i, j, 1.0, True, ink)
        return False

    @njit(cache=False)
    def descend(before: Any, after: Any, target: Any, plan: Any, sweeps: int, ink: Any) -> None:
        nx, ny = before.shape
        for _ in range(sweeps):
            changes = 0
            for i in range(nx):
                for j in range(ny):
                    sign = -1.0 if plan[i, j] else 1.0
                    if change(before, after, target, i, j, sign, False, ink) < -LEAST_GAIN:
                        change(before, after, target, i, j, sign, True, ink)
                        plan[i, j] = 1 - plan[i, j]
                        changes += 1
                    if plan[i, j] and swap(before, after, target, plan, i, j, ink):
                        changes += 1
            if changes == 0:
                return

    def search(problem: HorizonProblem) -> IntPlan:
        plan = full_layers(problem).astype(np.int32)
        after = bindings.layer(problem.height, plan[0], problem.kinds)
        descend(problem.height, after, problem.target, plan[0], SWEEPS, (INK.h1, INK.h2, INK.h3))
        return plan

    search(rough(5))  # compiles
    return search
