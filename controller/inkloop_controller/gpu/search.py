"""The repair of a plan on an OpenCL device: the best moves of cells that do not meet, all at once (moves.cl)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import sqrt
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from inkloop_controller.core.library import CORE_BUDGET, CORE_DONE, CORE_STOPPED, CORE_TIME
from inkloop_controller.gpu.device import DeviceError, chosen_device, described, device_errors
from inkloop_controller.problem.horizon_problem import IntPlan

GROUP = 32  # work items of a cell: those that a GPU runs in step
TILE = 16  # of moves.cl
ADDERS = 4096  # work items that add up a surface
LAUNCHES_A_LOOK = 64  # between two looks at the clock
ABYSS = -1.0  # height of the frame [m], of controller/core/search/plan_surface.c
UNIFORM_BOUND = sqrt(3.0)  # of a distribution with standard deviation 1
LEAST_SHARE_OF_DROPLET = 1e-9  # of plan_surface.c: gains below are rounding
LATTICE = 2.0**54  # heights are multiples of its inverse, of controller/core/model/lattice.h
SUM_STEP = 2.0**-60  # of the sums, as a share of the most that they can be
RULES = np.dtype(
    [(name, "i8") for name in ("nx", "ny", "stride", "framed", "tiles")]
    + [(name, "f8") for name in ("upward", "skew", "ceiling_cost", "chance", "least_chance")]
    + [(name, "f8") for name in ("alpha", "count", "reference", "least_gain", "height_step", "square_step")]
)
LAUNCH = np.dtype([(name, "i4") for name in ("layer", "period", "ci", "cj")])


class DeviceSearch:
    """The search on one device; problems of the same form share their program.

    It ends when no move of a single cell improves the plan, for alpha < 1 by a bound that moves made together keep: no
    sweep worsens the plan. The same problem gives the same plan on a device. Raises DeviceError where there is no
    device, where it fails, or where it lacks memory.
    """

    def __init__(self) -> None:
        self._device = chosen_device()
        self._name = described(self._device)
        with device_errors(self._name):
            self._queue = cl.CommandQueue(cl.Context([self._device]))
        self._programs: dict[tuple[int, ...], cl.Program] = {}

    def improve(self, problem: Any, options: Any, plan: IntPlan, after_sweep: Callable[[int], bool]) -> tuple[int, int]:
        """Improve a plan as inkloop_controller.core.bindings.Device says."""
        ends_at = perf_counter() + options.seconds_max
        with device_errors(self._name):
            self._check_memory(problem)
            surface = PlanOnDevice(self._queue, self._program(problem), problem, plan)
            try:
                return _sweeps(surface, options.sweeps_max, ends_at, after_sweep)
            finally:  # after Ctrl-C too
                surface.read_plan(plan)

    def _program(self, problem: Any) -> cl.Program:
        form = (problem.layers, problem.kinds, int(_has_ceiling(problem)), int(problem.alpha < 1.0))
        if form not in self._programs:
            names = dict(zip(("LAYERS", "KINDS", "CEILING", "DEVIATION"), form, strict=True), GROUP=GROUP)
            source = Path(__file__).with_name("moves.cl").read_text(encoding="utf-8")
            flags = [f"-D{name}={value}" for name, value in names.items()]
            self._programs[form] = cl.Program(self._queue.context, source).build(flags)
        return self._programs[form]

    def _check_memory(self, problem: Any) -> None:
        cells, layers = (problem.nx + 2) * (problem.ny + 2), problem.layers
        needed = cells * (8 * (layers + 5) + 3 * layers + 1)
        if needed > self._device.global_mem_size or 8 * cells * (layers + 1) > self._device.max_mem_alloc_size:
            raise DeviceError(
                f"a plan of {layers} layers of {problem.nx} x {problem.ny} cells takes {needed / 2**30:.1f} GiB, in "
                f"pieces of {8 * cells * (layers + 1) / 2**30:.1f} GiB, and {self._name} gives pieces of "
                f"{self._device.max_mem_alloc_size / 2**30:.1f} GiB; shorten the horizon, or plan with device = 'cpu'"
            )


class PlanOnDevice:
    """A plan and its surfaces on a device."""

    def __init__(self, queue: cl.CommandQueue, program: cl.Program, problem: Any, plan: IntPlan) -> None:
        self._queue, self._problem = queue, problem
        self._shape, layers = (problem.nx, problem.ny), problem.layers
        self.has_deviation = problem.alpha < 1.0
        part = _array(problem.part, self._shape, np.uint8)
        target = _array(problem.target, self._shape, np.float64)
        weight = _array(problem.weight, self._shape, np.float64) if problem.weight else part.astype(np.float64)
        ceiling = _array(problem.ceiling, self._shape, np.float64) if _has_ceiling(problem) else np.zeros((1, 1))
        droplets = _droplets(problem)
        rules = _rules(problem, part, droplets)
        moves = np.array(list(_launches(layers)), LAUNCH)
        spans = [
            -(-(side - moves[name]) // moves["period"]) for side, name in zip(self._shape, ("ci", "cj"), strict=True)
        ]
        self._groups = [int(rows * columns) if rows > 0 < columns else 0 for rows, columns in zip(*spans, strict=True)]
        self._rules, self._droplets = self._buffer(rules), self._buffer(droplets)
        self._height, self._chance = self._buffer(self._heights()), self._buffer(_framed(np.zeros(self._shape)))
        self._plan, self._part = self._buffer(_framed(plan.astype(np.uint8))), self._buffer(_framed(part))
        tiles = np.ones((-(-problem.nx // TILE), rules["tiles"]), np.uint8)
        self._awake, self._changed = self._buffer(tiles), self._buffer(tiles)
        self._sums, self._sums_after = (self._buffer(np.zeros(2, np.int64)) for _ in range(2))
        self._made = self._buffer(np.zeros(1, np.int32))
        self._arguments: tuple[Any, ...] = (
            *(self._rules, self._droplets, self._buffer(moves), np.int32(0)),
            *(self._height, self._plan, self._chance),
            *(self._buffer(_framed(map_)) for map_ in (target, weight, ceiling)),
            *(self._part, self._buffer(_array(problem.choices, (layers, *self._shape), np.uint16))),
            *(self._awake, self._changed, self._sums, self._sums_after, self._made),
        )  # kept: a kernel does not keep its buffers
        self._try_moves = cl.Kernel(program, "try_moves")
        self._try_moves.set_args(*self._arguments)
        self._print(program)

    def sweep(self, is_whole: bool) -> Iterator[None]:
        """Make the best move of each cell, or of each near a change of the last sweep; stops now and then."""
        if is_whole:
            self._fill(self._awake, np.uint8(1))
        else:
            cl.enqueue_copy(self._queue, self._awake, self._changed)
        self._fill(self._changed, np.uint8(0))
        self._fill(self._made, np.int32(0))
        for number, groups in enumerate(self._groups):
            if not groups:
                continue
            self._try_moves.set_arg(3, np.int32(number))
            cl.enqueue_nd_range_kernel(self._queue, self._try_moves, (groups * GROUP,), (GROUP,))
            if self.has_deviation:
                self._keep_sums()
            if number % LAUNCHES_A_LOOK == 0:
                self._queue.finish()
                yield

    @property
    def made(self) -> int:
        """Moves made in the last sweep."""
        found = np.empty(1, np.int32)
        cl.enqueue_copy(self._queue, found, self._made)
        return int(found[0])

    def read_plan(self, plan: IntPlan) -> None:
        """Write the plan of the device into this one."""
        plan[...] = self._read(self._plan, len(plan), np.uint8)

    def read_heights(self) -> NDArray[np.float64]:
        """(layers + 1, nx, ny) the surfaces before the first layer and after each [m]."""
        return self._read(self._height, self._problem.layers + 1, np.float64)

    def _read(self, buffer: cl.Buffer, maps: int, dtype: Any) -> NDArray[Any]:
        framed = np.empty((maps, self._shape[0] + 2, self._shape[1] + 2), dtype)
        cl.enqueue_copy(self._queue, framed, buffer)
        return framed[:, 1:-1, 1:-1]

    def _fill(self, buffer: cl.Buffer, value: Any) -> None:
        cl.enqueue_fill_buffer(self._queue, buffer, value, 0, buffer.size)

    def _keep_sums(self) -> None:
        cl.enqueue_copy(self._queue, self._sums, self._sums_after)

    def _print(self, program: cl.Program) -> None:
        kernel = cl.Kernel(program, "print_layer")
        for layer in range(self._problem.layers):
            maps = (self._height, self._plan, self._chance, np.int32(layer))
            kernel(self._queue, self._shape[::-1], None, self._rules, self._droplets, *maps)
        if self.has_deviation:
            add_up = cl.Kernel(program, "add_up")
            add_up(self._queue, (ADDERS,), None, self._rules, self._height, self._chance, self._part, self._sums_after)
            self._keep_sums()

    def _heights(self) -> NDArray[np.float64]:
        """(layers + 1, nx + 2, ny + 2): the first surface, and the frame of all."""
        nx, ny = self._shape
        found = np.full((self._problem.layers + 1, nx + 2, ny + 2), ABYSS)
        found[0, 1:-1, 1:-1] = np.rint(_array(self._problem.height, self._shape, np.float64) * LATTICE) / LATTICE
        return found

    def _buffer(self, array: NDArray[Any]) -> cl.Buffer:
        flags = cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR
        return cl.Buffer(self._queue.context, flags, hostbuf=np.ascontiguousarray(array))


def _sweeps(
    surface: PlanOnDevice, sweeps_max: int, ends_at: float, after_sweep: Callable[[int], bool]
) -> tuple[int, int]:
    is_whole = True
    for sweep in range(1, sweeps_max + 1):
        for _ in surface.sweep(is_whole):
            if perf_counter() > ends_at:
                return CORE_TIME, sweep
        is_idle = surface.made == 0
        if is_idle and (is_whole or not surface.has_deviation):
            return CORE_DONE, sweep
        is_whole = is_idle  # any move changes the deviation of all: cells that slept are tried once more
        if after_sweep(sweep):
            return CORE_STOPPED, sweep
    return CORE_BUDGET, sweeps_max


def _has_ceiling(problem: Any) -> bool:
    return problem.ceiling_cost > 0.0 and bool(problem.ceiling)


def _rules(problem: Any, part: NDArray[np.uint8], droplets: NDArray[np.float64]) -> NDArray[Any]:
    """The Rules of moves.cl. Heights are added up from the mean of the first surface on, which lies near the last."""
    kinds, count = problem.kind[: problem.kinds], float(part.sum())
    chance, stride = UNIFORM_BOUND * problem.droplet_std, problem.ny + 2
    height = _array(problem.height, part.shape, np.float64)[part > 0]
    reference = np.rint(height.mean() * LATTICE) / LATTICE
    most = abs(height - reference).max() + 2.0 * problem.layers * droplets[:, 0].max()  # of a cell: its own, and shares
    return np.array(
        (
            *(problem.nx, problem.ny, stride, (problem.nx + 2) * stride, -(-problem.ny // TILE)),
            *(0.5 * (problem.overshoot + 1.0), 0.5 * (problem.overshoot - 1.0), problem.ceiling_cost),
            *(chance, chance * min(kind.h1 for kind in kinds)),
            *(problem.alpha, count, reference),
            LEAST_SHARE_OF_DROPLET * max(kind.h1 for kind in kinds) / count,
            *(count * most * SUM_STEP, count * most**2 * SUM_STEP),
        ),
        RULES,
    )


def _droplets(problem: Any) -> NDArray[np.float64]:
    """(kinds + 1, 5) of nothing and each kind: volume, spread and slope of sides and corners (droplet_flow.h)."""
    found = np.zeros((problem.kinds + 1, 5))
    for row, ink in zip(found[1:], problem.kind, strict=False):
        top, side, corner = ((height + 0.375) - 0.375 for height in (ink.h1, ink.h2, ink.h3))  # onto the lattice
        volume, slopes = top + 4.0 * side + 4.0 * corner, (ink.h2 / (ink.h1 + ink.h2), ink.h3 / (ink.h1 + ink.h3))
        row[:] = (volume, side, corner, *slopes)
    return found


def _launches(layers: int) -> Iterator[tuple[int, ...]]:
    """Rows of LAUNCH: all cells of all layers, those together whose windows do not meet."""
    for layer in reversed(range(layers)):
        period = 2 * (layers - layer + 1) + 2  # a swap reaches a cell further than its layers
        yield from ((layer, period, ci, cj) for ci in range(period) for cj in range(period))


def _array(pointer: Any, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    """The map that a pointer of C points to, where it lies."""
    return np.ctypeslib.as_array(pointer, shape).view(dtype)


def _framed(array: NDArray[Any]) -> NDArray[Any]:
    """With a frame of zeros around the last two axes."""
    return np.pad(array, [(0, 0)] * (array.ndim - 2) + [(1, 1)] * 2)
