"""The layer map alone, compared with loops in Numba and with what memory and arithmetic allow, in processor time."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from time import process_time
from typing import Any

import numpy as np
from rich.console import Group
from rich.text import Text

from benchmarks.machine import arithmetic
from benchmarks.timing import scaled, table_of
from inkloop_lab.models.library import HEIGHT_COUNT, FarInkStruct, integers, library, reals
from support.numpy.lu_numpy import INK, one_pass

SIDES = (100, 500, 1000, 2048)
BYTES = 4 + 8 + 8 + 16
"""Of a cell that have to travel: pattern, volume and height are read, the new height is read and written."""
OPERATIONS = 4 * 9 + 8 * 3 + 10 + 5
"""Of a cell: pairs of neighbours, what is kept, sums, the droplet itself; a division counts as one."""
ROUNDS = 7


def measure() -> Group:
    """Time per cell of a pass on a rough surface."""
    loops, operations = _numba_loops(), OPERATIONS / arithmetic()
    names = ["inkloop", *loops, "NumPy"]
    table = table_of(
        "the layer map per cell: pattern half full at random, volumes at random; processor time",
        ("grid", *names, "floor: memory", "arithmetic", *(f"{name} / inkloop" for name in names[1:])),
    )
    for side in SIDES:
        height, pattern, volume = _layer(side)
        calls = {"inkloop": _ours(height, pattern, volume)}
        for name, loop in loops.items():
            calls[name] = _of_loop(loop, height, pattern, volume)
        calls["NumPy"] = lambda h=height, p=pattern, v=volume: one_pass(h, p, factor=v)
        times = _least(calls)
        cells = side * side
        floors = (_stream(cells) * BYTES, operations)
        ratios = (f"{times[name] / times['inkloop']:.1f}" for name in names[1:])
        table.add_row(
            f"{side} x {side}",
            *(scaled(times[name] / cells) for name in names),
            *(scaled(floor) for floor in floors),
            *ratios,
        )
    notes = [
        f"floors: {BYTES} bytes per cell at the speed of a copy of as many bytes, {OPERATIONS} operations at that of a "
        "product of matrices in the cache, both by NumPy in the same run"
    ]
    if not loops:
        notes.append("Numba is not installed, so its loops are left out: pip install numba")
    return Group(table, *(Text(note) for note in notes))


def _layer(side: int) -> tuple[Any, Any, Any]:
    rng = np.random.default_rng(1)
    shape = (side, side)
    pattern = (rng.random(shape) < 0.5).astype(np.int32)
    return rng.uniform(0.0, 8e-6, shape), pattern, rng.uniform(0.8, 1.0, shape)


def _ours(height: Any, pattern: Any, volume: Any) -> Callable[[], object]:
    after = height.copy()
    ink = FarInkStruct((INK + (0.0,) * HEIGHT_COUNT)[:HEIGHT_COUNT])
    grid = (*height.shape, reals(height), reals(after), integers(pattern))
    arguments = (*grid, (FarInkStruct * 2)(ink, ink), 1, reals(volume), -1)
    return lambda: library().inkloop_layer_pass(*arguments)


def _of_loop(loop: Callable[..., object], height: Any, pattern: Any, volume: Any) -> Callable[[], object]:
    after = height.copy()
    loop(height[:3, :3].copy(), after[:3, :3].copy(), pattern[:3, :3].copy(), volume[:3, :3].copy(), *INK)  # compiles
    return lambda: loop(height, after, pattern, volume, *INK)


def _least(calls: dict[str, Callable[[], object]]) -> dict[str, float]:
    """Least processor time of one call [s], the calls by turns, so that all have the same neighbours."""
    found: dict[str, float] = {}
    for _ in range(ROUNDS):
        for name, call in calls.items():
            found[name] = min(found.get(name, np.inf), _once(call))
    return found


def _once(call: Callable[[], object], at_least_s: float = 0.01) -> float:
    repeats, begin = 0, process_time()
    while repeats == 0 or process_time() - begin < at_least_s:
        call()
        repeats += 1
    return (process_time() - begin) / repeats


def _stream(cells: int) -> float:
    """Seconds per byte read or written, by a copy of as many bytes as a pass moves."""
    source = np.ones(cells * BYTES // 16)
    target = np.empty_like(source)
    return _least({"copy": lambda: np.copyto(target, source)})["copy"] / (2 * source.nbytes)


def _numba_loops() -> dict[str, Callable[..., object]]:
    """The loop that one writes in an afternoon, and the same without branches; none where Numba is not installed."""
    if importlib.util.find_spec("numba") is None:
        return {}
    from numba import njit

    @njit(cache=False)
    def plain(before: Any, after: Any, pattern: Any, volume: Any, h1: float, h2: float, h3: float) -> None:
        nx, ny = before.shape
        for i in range(nx):
            for j in range(ny):
                if pattern[i, j] == 0:
                    continue
                own = h1 * volume[i, j]
                kept = own
                for di in range(-1, 2):
                    for dj in range(-1, 2):
                        if di == 0 and dj == 0:
                            continue
                        part = (h2 if di == 0 or dj == 0 else h3) * volume[i, j]
                        p, q = i + di, j + dj
                        if p < 0 or q < 0 or p >= nx or q >= ny:
                            continue
                        rise, width = before[i, j] - before[p, q], own + part
                        taken = part
                        if rise <= -width:
                            taken = 0.0
                        elif rise < 0.0:
                            taken = part * (1.0 + rise / width)
                        after[p, q] += taken
                        kept += part - taken
                after[i, j] += kept

    @njit(cache=False)
    def branch_free(before: Any, after: Any, pattern: Any, volume: Any, h1: float, h2: float, h3: float) -> None:
        nx, ny = before.shape
        for i in range(1, nx - 1):
            for di in range(-1, 2):
                for dj in range(-1, 2):
                    if di == 0 and dj == 0:
                        continue
                    h = h2 if di == 0 or dj == 0 else h3
                    for j in range(1, ny - 1):
                        given = min(pattern[i, j], 1) * volume[i, j]
                        taken = min(pattern[i + di, j + dj], 1) * volume[i + di, j + dj]
                        rise = before[i, j] - before[i + di, j + dj]
                        share = min(max(1.0 + rise / ((h1 + h) * volume[i, j]), 0.0), 1.0)
                        back = min(max(1.0 - rise / ((h1 + h) * volume[i + di, j + dj]), 0.0), 1.0)
                        after[i, j] += h * (given * (1.0 - share) + taken * back)
            for j in range(1, ny - 1):
                after[i, j] += h1 * min(pattern[i, j], 1) * volume[i, j]

    return {"Numba": plain, "Numba, branch-free": branch_free}
