"""Moves that do not meet, tried at once: the repair of a plan on an OpenCL device (moves.cl)."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from functools import cached_property
from math import sqrt
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from inkloop_controller.core.library import CORE_BUDGET, CORE_DONE, CORE_STOPPED, CORE_TIME

GROUP = 32  # work items of a move: those that a GPU runs in step
TILE = 16  # of moves.cl
ADDERS = 4096  # work items that add up a surface
ABYSS = -1.0  # height of the frame [m], of controller/core/search/plan_surface.c
UNIFORM_BOUND = sqrt(3.0)  # of a distribution with standard deviation 1
LEAST_SHARE_OF_DROPLET = 1e-9  # of plan_surface.c: gains below are rounding
LATTICE = 2.0**54  # heights are multiples of its inverse, of controller/core/model/lattice.h
RULES = np.dtype(
    [(name, "i8") for name in ("nx", "ny", "stride", "framed", "tiles")]
    + [(name, "f8") for name in ("upward", "skew", "ceiling_cost", "chance", "least_chance")]
    + [(name, "f8") for name in ("alpha", "count", "reference", "least_gain", "height_step", "square_step")]
)
LAUNCH = np.dtype([(name, "i4") for name in ("layer", "period", "ci", "cj")])


class Ending(NamedTuple):
    """End of a search: a CORE_... of horizon_problem.h, and the sweeps made."""

    code: int
    sweeps: int


class DeviceSearch:
    """The search on one device; problems of the same shape share their program.

    Raises pyopencl.Error where the device fails, MemoryError where a problem does not fit.
    """

    def __init__(self, device: cl.Device) -> None:
        self._context = cl.Context([device])
        self._queue = cl.CommandQueue(self._context)
        self._programs: dict[tuple[int, int, bool, bool], cl.Program] = {}

    def improve(
        self, problem: Any, options: Any, plan: NDArray[np.int32], after_sweep: Callable[[int], bool]
    ) -> Ending:
        """Improve a plan (layers, nx, ny) in place. problem, options: HorizonProblem and SearchOptions of the core."""
        ends_at = perf_counter() + options.seconds_max
        shape = (problem.layers, problem.kinds, problem.ceiling_cost > 0.0 and bool(problem.ceiling), problem.alpha < 1.0)
        if shape not in self._programs:
            names = dict(zip(("LAYERS", "KINDS", "CEILING", "DEVIATION"), map(int, shape), strict=True), GROUP=GROUP)
            source = Path(__file__).with_name("moves.cl").read_text(encoding="utf-8")
            flags = [f"-D{name}={value}" for name, value in names.items()]
            self._programs[shape] = cl.Program(self._context, source).build(flags)
        surface = _Surface(self._queue, self._programs[shape], problem, plan)
        try:
            return self._sweeps(surface, options.sweeps_max, ends_at, after_sweep)
        finally:
            surface.read_plan(plan)

    def _sweeps(
        self, surface: _Surface, sweeps: int, ends_at: float, after_sweep: Callable[[int], bool]
    ) -> Ending:
        is_whole = True
        for sweep in range(1, sweeps + 1):
            for _ in surface.sweep(is_whole):
                if perf_counter() > ends_at:
                    return Ending(CORE_TIME, sweep)
            is_idle = surface.made == 0
            if is_idle and (is_whole or not surface.has_deviation):
                return Ending(CORE_DONE, sweep)
            is_whole = is_idle  # the deviation changes everywhere: tiles that slept are tried once more
            if after_sweep(sweep):
                return Ending(CORE_STOPPED, sweep)
        return Ending(CORE_BUDGET, sweeps)


class _Surface:
    """The surfaces of a plan on the device, and the launches that change them."""

    def __init__(self, queue: cl.CommandQueue, program: cl.Program, problem: Any, plan: NDArray[np.int32]) -> None:
        self._queue, self._context, self._problem = queue, queue.context, problem
        self._shape = problem.nx, problem.ny
        self.has_deviation = problem.alpha < 1.0
        cells, layers = self._shape, problem.layers
        part = _array(problem.part, cells, np.uint8)
        target = _array(problem.target, cells, np.float64)
        weight = _array(problem.weight, cells, np.float64) if problem.weight else part.astype(np.float64)
        heights = np.zeros((layers + 1, cells[0] + 2, cells[1] + 2))
        heights[:, 1:-1, 1:-1] = np.rint(_array(problem.height, cells, np.float64) * LATTICE) / LATTICE
        heights[:, (0, -1)] = heights[:, :, (0, -1)] = ABYSS
        rules, self._tiles = self._rules(part, target)
        self._rules_of, self._droplets = self._constant(rules), self._constant(_droplets(problem))
        self._height, self._chance = self._buffer(heights), self._buffer(_framed(np.zeros(cells)))
        self._plan = self._buffer(_framed(plan.astype(np.uint8)))
        maps = [_framed(target), _framed(weight)]
        ceiling = problem.ceiling_cost > 0.0 and bool(problem.ceiling)
        maps.append(_framed(_array(problem.ceiling, cells, np.float64)) if ceiling else np.zeros(1))
        self._part = self._buffer(_framed(part))
        choices = self._buffer(_array(problem.choices, (layers, *cells), np.uint16))
        self._awake, self._changed = (self._buffer(np.ones(self._tiles, np.uint8)) for _ in range(2))
        self._sums, self._sums_after = (self._buffer(np.zeros(2, np.int64)) for _ in range(2))
        self._made = self._buffer(np.zeros(1, np.int32))
        moves = np.array(list(_launches(layers)), LAUNCH)
        self._groups = [
            -(-(cells[0] - ci) // period) * -(-(cells[1] - cj) // period)
            for period, ci, cj in zip(moves["period"], moves["ci"], moves["cj"], strict=True)
        ]
        self._arguments = (
            *(self._rules_of, self._droplets, self._constant(moves), np.int32(0)),
            *(self._height, self._plan, self._chance, *map(self._buffer, maps), self._part, choices),
            *(self._awake, self._changed, self._sums, self._sums_after, self._made),
        )  # a kernel does not keep its buffers
        self._try = cl.Kernel(program, "try_moves")
        self._try.set_args(*self._arguments)
        self._print(program, layers)
        if self.has_deviation:
            add_up = cl.Kernel(program, "add_up")
            add_up(queue, (ADDERS,), None, self._rules_of, self._height, self._chance, self._part, self._sums_after)
            self._keep_sums()

    def sweep(self, is_whole: bool) -> Iterator[None]:
        """Try all moves, of all cells or of those that are awake; stops after each kind of move."""
        if is_whole:
            cl.enqueue_fill_buffer(self._queue, self._awake, np.uint8(1), 0, self._awake.size)
        else:
            cl.enqueue_copy(self._queue, self._awake, self._changed)
        cl.enqueue_fill_buffer(self._queue, self._changed, np.uint8(0), 0, self._changed.size)
        cl.enqueue_fill_buffer(self._queue, self._made, np.int32(0), 0, self._made.size)
        for launch, groups in enumerate(self._groups):
            if groups <= 0:
                continue
            self._try.set_arg(3, np.int32(launch))
            cl.enqueue_nd_range_kernel(self._queue, self._try, (groups * GROUP,), (GROUP,))
            if self.has_deviation:
                self._keep_sums()
            if launch % LAUNCHES_A_LOOK == 0:
                self._queue.finish()
                yield

    @property
    def made(self) -> int:
        """Moves made in the last sweep."""
        found = np.empty(1, np.int32)
        cl.enqueue_copy(self._queue, found, self._made)
        return int(found[0])

    def read_plan(self, plan: NDArray[np.int32]) -> None:
        """Write the plan of the device into this one."""
        framed = np.empty((len(plan), self._shape[0] + 2, self._shape[1] + 2), np.uint8)
        cl.enqueue_copy(self._queue, framed, self._plan)
        plan[...] = framed[:, 1:-1, 1:-1]

    def heights(self) -> NDArray[np.float64]:
        """(layers + 1, nx, ny) the surfaces before the first layer and after each [m]."""
        framed = np.empty((self._problem.layers + 1, self._shape[0] + 2, self._shape[1] + 2))
        cl.enqueue_copy(self._queue, framed, self._height)
        return framed[:, 1:-1, 1:-1]

    def _keep_sums(self) -> None:
        cl.enqueue_copy(self._queue, self._sums, self._sums_after)

    def _print(self, program: cl.Program, layers: int) -> None:
        kernel = cl.Kernel(program, "print_layer")
        for layer in range(layers):
            maps = (self._height, self._plan, self._chance, np.int32(layer))
            kernel(self._queue, (self._shape[1], self._shape[0]), None, self._rules_of, self._droplets, *maps)

    def _rules(self, part: NDArray[np.uint8], target: NDArray[np.float64]) -> tuple[NDArray[Any], tuple[int, int]]:
        problem, (nx, ny) = self._problem, self._shape
        kinds, count = problem.kind[: problem.kinds], float(part.sum())
        chance = UNIFORM_BOUND * problem.droplet_std
        tiles = -(-nx // TILE), -(-ny // TILE)
        return np.array(
            (
                *(nx, ny, ny + 2, (nx + 2) * (ny + 2), tiles[1]),
                *(0.5 * (problem.overshoot + 1.0), 0.5 * (problem.overshoot - 1.0), problem.ceiling_cost),
                *(chance, chance * min(kind.h1 for kind in kinds)),
                *(problem.alpha, count, np.rint(target[part > 0].mean() * LATTICE) / LATTICE),
                LEAST_SHARE_OF_DROPLET * max(kind.h1 for kind in kinds) / count,
                *(count * 2.0**-70, count * 2.0**-80),
            ),
            RULES,
        ), tiles

    def _buffer(self, array: NDArray[Any]) -> cl.Buffer:
        flags = cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR
        return cl.Buffer(self._context, flags, hostbuf=np.ascontiguousarray(array))

    def _constant(self, array: NDArray[Any]) -> cl.Buffer:
        flags = cl.mem_flags.READ_ONLY | cl.mem_flags.COPY_HOST_PTR
        return cl.Buffer(self._context, flags, hostbuf=np.ascontiguousarray(array))


LAUNCHES_A_LOOK = 64


def _array(pointer: Any, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    """What a pointer of C points to, where it lies."""
    return np.ctypeslib.as_array(pointer, shape).view(dtype)


def _framed(array: NDArray[Any]) -> NDArray[Any]:
    """With a frame of zeros around the last two axes."""
    return np.pad(array, [(0, 0)] * (array.ndim - 2) + [(1, 1)] * 2)


def _droplets(problem: Any) -> NDArray[np.float64]:
    """(kinds + 1, 5) of nothing and each kind: volume, spread and slope of sides and corners (droplet_flow.h)."""
    found = np.zeros((problem.kinds + 1, 5))
    for row, ink in zip(found[1:], problem.kind, strict=False):
        top, side, corner = ((h + 0.375) - 0.375 for h in (ink.h1, ink.h2, ink.h3))
        row[:] = (
            *(top + 4.0 * side + 4.0 * corner, side, corner),
            *(ink.h2 / (ink.h1 + ink.h2), ink.h3 / (ink.h1 + ink.h3)),
        )
    return found


def _launches(layers: int) -> Iterator[tuple[int, ...]]:
    """Rows of LAUNCH: all cells of all layers, those together whose windows do not meet."""
    for layer in reversed(range(layers)):
        period = 2 * (layers - layer + 1) + 2  # a swap reaches a cell further than its layers
        yield from ((layer, period, ci, cj) for ci in range(period) for cj in range(period))
