"""A plan and its surfaces on an OpenCL device (moves.cl)."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from math import sqrt
from typing import Any

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from inkloop_controller.gpu.maps import DeviceMaps
from inkloop_controller.problem.horizon_problem import IntPlan

GROUP = 32  # work items of a cell: those that a GPU runs in step
TEAM = 16  # of them, those that try a move together
NUMBER = 4  # of the arguments of try_moves, that of the launch
IN_A_LAYER, BETWEEN_LAYERS = 1, 2  # sorts of moves, of moves.cl
LEAST_GROUPS = 1 << 14  # of a launch before one tries several cells: what a large GPU takes at once
ADDERS = 4096  # work items that add up a surface
LAUNCHES_A_LOOK = 64  # between two looks at the clock
ABYSS = -1.0  # height of the frame [m], of controller/core/search/plan_surface.c
UNIFORM_BOUND = sqrt(3.0)  # of a distribution with standard deviation 1
LEAST_SHARE_OF_DROPLET = 1e-9  # of plan_surface.c: gains below are rounding
LEAST_TRIED = 1e-5  # the same in single precision
LATTICE = 2.0**54  # heights are multiples of its inverse, of controller/core/model/lattice.h
SUM_STEP = 2.0**-60  # of the sums, as a share of the most that they can be
RULES = np.dtype(
    [(name, "i8") for name in ("nx", "ny", "stride", "framed")]
    + [(name, "f8") for name in ("upward", "skew", "ceiling_cost", "chance", "least_chance")]
    + [
        (name, "f8")
        for name in ("alpha", "count", "reference", "least_gain", "least_trial", "height_step", "square_step")
    ]
)
LAUNCH = np.dtype([(name, "i4") for name in ("sort", "layer", "period", "ci", "cj", "batch")])


class PlanOnDevice:
    """A plan and its surfaces on a device."""

    def __init__(self, maps: DeviceMaps, program: cl.Program, problem: Any, plan: IntPlan) -> None:
        self._maps, self._queue, self._problem = maps, maps.queue, problem
        shape, layers = maps.shape, problem.layers
        self.layers, self.has_deviation = layers, problem.alpha < 1.0
        part, height = _array(problem.part, shape, np.uint8), _array(problem.height, shape, np.float64)
        droplets, launches = _droplets(problem), list(_launches(shape, layers))
        self._groups = [(number, sort, groups) for number, ((sort, *_), groups) in enumerate(launches)]
        rules = _rules(problem, part, droplets)
        maps.room("height", layers + 1, np.float64, ABYSS)
        self._height = maps.put("height", height)
        self._plan, self._chance = maps.put("plan", plan.astype(np.uint8)), maps.room("chance", 1, np.float64)
        self._part = maps.put("part", part, stays=True)
        self._rules, self._droplets = maps.small("rules", rules), maps.small("droplets", droplets)
        self._awake = maps.room("awake", layers, np.uint8)
        self._sums, self._sums_after = (maps.small(name, np.zeros(2, np.int64)) for name in ("sums", "sums after"))
        self._made = maps.small("made", np.zeros(1, np.int32))
        target = maps.put("target", _array(problem.target, shape, np.float64), stays=True)
        weight = maps.put("weight", _array(problem.weight, shape, np.float64), stays=True) if problem.weight else target
        ceiling = maps.put("ceiling", _array(problem.ceiling, shape, np.float64)) if has_ceiling(problem) else target
        self._try_moves = cl.Kernel(program, "try_moves")
        self._try_moves.set_args(
            *(self._rules, self._droplets, maps.small("tried", _tried(droplets))),
            *(maps.small("launches", np.array([launch for launch, _ in launches], LAUNCH)), np.int32(0)),
            *(self._height, self._plan, self._chance),
            *(target, weight, ceiling, self._part),
            maps.put("choices", _array(problem.choices, (layers, *shape), np.uint16), stays=True),
            *(self._awake, self._sums, self._sums_after, self._made),
        )
        self._print(program)

    def wake(self) -> None:
        """Let all moves be tried again."""
        self._fill(self._awake, np.uint8(IN_A_LAYER | BETWEEN_LAYERS))

    def sweep(self, sort: int) -> Iterator[None]:
        """Make the best move of a sort of each cell near which something has changed since; stops now and then."""
        self._fill(self._made, np.int32(0))
        for number, its_sort, groups in self._groups:
            if its_sort != sort:
                continue
            self._try_moves.set_arg(NUMBER, np.int32(number))
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
        return self._maps.read("height", self.layers + 1, np.float64)

    def _fill(self, buffer: cl.Buffer, value: Any) -> None:
        cl.enqueue_fill_buffer(self._queue, buffer, value, 0, buffer.size)

    def _keep_sums(self) -> None:
        cl.enqueue_copy(self._queue, self._sums, self._sums_after)

    def _print(self, program: cl.Program) -> None:
        cl.Kernel(program, "take_height")(self._queue, self._maps.shape[::-1], None, self._rules, self._height)
        kernel = cl.Kernel(program, "print_layer")
        for layer in range(self.layers):
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
    kinds, count = problem.kind[: problem.kinds], float(np.count_nonzero(part))
    chance, stride = UNIFORM_BOUND * problem.droplet_std, problem.ny + 2
    reference, most = 0.0, 2.0 * problem.layers * droplets[:, 0].max()  # of a cell: its own droplets, and shares
    if problem.alpha < 1.0:
        height = _array(problem.height, part.shape, np.float64)[part > 0]
        reference = np.rint(height.mean() * LATTICE) / LATTICE
        most += abs(height - reference).max()
    return np.array(
        (
            *(problem.nx, problem.ny, stride, (problem.nx + 2) * stride),
            *(0.5 * (problem.overshoot + 1.0), 0.5 * (problem.overshoot - 1.0), problem.ceiling_cost),
            *(chance, chance * min(kind.h1 for kind in kinds)),
            *(problem.alpha, count, reference),
            *(least * max(kind.h1 for kind in kinds) / count for least in (LEAST_SHARE_OF_DROPLET, LEAST_TRIED)),
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


def _tried(droplets: NDArray[np.float64]) -> NDArray[np.float32]:
    """The same for trials: volume, spread, and slope as a share of the spread."""
    tried = droplets.astype(np.float32)
    np.divide(droplets[:, 3:], droplets[:, 1:3], out=tried[:, 3:], where=droplets[:, 1:3] > 0.0, casting="same_kind")
    return tried


def _launches(shape: tuple[int, int], layers: int) -> Iterator[tuple[tuple[int, ...], int]]:
    """Rows of LAUNCH and their groups: all moves of all cells, those together whose windows do not meet."""
    for sort, layer in product((IN_A_LAYER, BETWEEN_LAYERS), reversed(range(layers))):
        if sort == BETWEEN_LAYERS and layer == layers - 1:
            continue  # a droplet goes to a later layer, or comes from there
        period = 2 * (layers - layer + (sort == IN_A_LAYER)) + 2  # a swap reaches a cell further than its layers
        for ci, cj in product(range(min(period, shape[0])), range(min(period, shape[1]))):
            cells = -(-(shape[0] - ci) // period) * -(-(shape[1] - cj) // period)
            batch = min(max(cells // LEAST_GROUPS, 1), GROUP)
            yield (sort, layer, period, ci, cj, batch), -(-cells // batch)


def _array(pointer: Any, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    """The map that a pointer of C points to, where it lies."""
    return np.ctypeslib.as_array(pointer, shape).view(dtype)
