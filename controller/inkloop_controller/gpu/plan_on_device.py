"""A plan and its surfaces on an OpenCL device (moves.cl)."""

from __future__ import annotations

from collections.abc import Iterator
from math import sqrt
from typing import Any

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from inkloop_controller.gpu.maps import DeviceMaps
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


class PlanOnDevice:
    """A plan and its surfaces on a device."""

    def __init__(self, maps: DeviceMaps, program: cl.Program, problem: Any, plan: IntPlan) -> None:
        self._maps, self._queue, self._problem = maps, maps.queue, problem
        shape, layers = maps.shape, problem.layers
        self.has_deviation = problem.alpha < 1.0
        part, height = _array(problem.part, shape, np.uint8), _array(problem.height, shape, np.float64)
        weight = _array(problem.weight, shape, np.float64) if problem.weight else part.astype(np.float64)
        droplets, moves = _droplets(problem), np.array(list(_launches(layers)), LAUNCH)
        rules = _rules(problem, part, droplets)
        tiles = np.ones((-(-problem.nx // TILE), rules["tiles"]), np.uint8)
        spans = [-(-(side - moves[name]) // moves["period"]) for side, name in zip(shape, ("ci", "cj"), strict=True)]
        self._groups = [int(rows * columns) if rows > 0 < columns else 0 for rows, columns in zip(*spans, strict=True)]
        maps.room("height", layers + 1, np.float64, ABYSS)
        self._height = maps.put("height", np.rint(height * LATTICE) / LATTICE)
        self._plan, self._chance = maps.put("plan", plan.astype(np.uint8)), maps.room("chance", 1, np.float64)
        self._part = maps.put("part", part, stays=True)
        self._rules, self._droplets = maps.small("rules", rules), maps.small("droplets", droplets)
        self._awake, self._changed = (maps.small(name, tiles) for name in ("awake", "changed"))
        self._sums, self._sums_after = (maps.small(name, np.zeros(2, np.int64)) for name in ("sums", "sums after"))
        self._made = maps.small("made", np.zeros(1, np.int32))
        weights = maps.put("weight", weight, stays=True)
        ceiling = maps.put("ceiling", _array(problem.ceiling, shape, np.float64)) if has_ceiling(problem) else weights
        self._try_moves = cl.Kernel(program, "try_moves")
        self._try_moves.set_args(
            *(self._rules, self._droplets, maps.small("launches", moves), np.int32(0)),
            *(self._height, self._plan, self._chance),
            *(maps.put("target", _array(problem.target, shape, np.float64), stays=True), weights, ceiling, self._part),
            maps.put("choices", _array(problem.choices, (layers, *shape), np.uint16), stays=True),
            *(self._awake, self._changed, self._sums, self._sums_after, self._made),
        )
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
        plan[...] = self._maps.read("plan", len(plan), np.uint8)

    def read_heights(self) -> NDArray[np.float64]:
        """(layers + 1, nx, ny) the surfaces before the first layer and after each [m]."""
        return self._maps.read("height", self._problem.layers + 1, np.float64)

    def _fill(self, buffer: cl.Buffer, value: Any) -> None:
        cl.enqueue_fill_buffer(self._queue, buffer, value, 0, buffer.size)

    def _keep_sums(self) -> None:
        cl.enqueue_copy(self._queue, self._sums, self._sums_after)

    def _print(self, program: cl.Program) -> None:
        kernel = cl.Kernel(program, "print_layer")
        for layer in range(self._problem.layers):
            maps = (self._height, self._plan, self._chance, np.int32(layer))
            kernel(self._queue, self._maps.shape[::-1], None, self._rules, self._droplets, *maps)
        if self.has_deviation:
            add_up = cl.Kernel(program, "add_up")
            add_up(self._queue, (ADDERS,), None, self._rules, self._height, self._chance, self._part, self._sums_after)
            self._keep_sums()


def has_ceiling(problem: Any) -> bool:
    """Whether a metre above the ceiling costs anything."""
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
