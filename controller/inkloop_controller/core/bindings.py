"""The search core from Python: arrays in, arrays out, every array checked before C sees it."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap, Ink
from inkloop_controller.core.library import library
from inkloop_controller.core.structs import (
    AfterSweep,
    InkStruct,
    ObjectiveStruct,
    ProblemStruct,
    ReportStruct,
    SearchOptionsStruct,
)
from inkloop_controller.problem.arrays import error_of_array, error_of_layout, first_cell
from inkloop_controller.problem.horizon_problem import (
    HORIZON_MAX,
    KINDS_MAX,
    ChoiceMaps,
    HorizonProblem,
    IntMap,
    IntPlan,
    Moves,
    Objective,
    SearchProgress,
    SearchResult,
    SearchStatus,
)

__all__ = [
    "HORIZON_MAX",
    "KINDS_MAX",
    "ChoiceMaps",
    "HorizonProblem",
    "IntMap",
    "IntPlan",
    "Moves",
    "Objective",
    "SearchProgress",
    "SearchResult",
    "SearchStatus",
    "layer",
    "objective",
    "paper_search",
    "search",
    "split",
]

_NO_MEMORY, _NO_SCAN = 4, 5


def objective(problem: HorizonProblem, plan: IntPlan) -> Objective:
    """Objective of a plan (layers, nx, ny)."""
    droplets = _droplets(problem, plan)
    found = ObjectiveStruct()
    answered(library().inkloop_objective(problem_struct(problem), pointer(droplets), found))
    return objective_of(found)


def search(
    problem: HorizonProblem,
    start: IntPlan,
    *,
    sweeps_max: int,
    moves: Moves = Moves.ALL,
    annealing_sweeps: int = 0,
    seed: int = 0,
    seconds_max: float = inf,
    threads: int = 1,
    after_sweep: Callable[[SearchProgress], bool] | None = None,
) -> SearchResult:
    """Improve a plan by `moves` until none helps, or for `sweeps_max` sweeps; the result is never worse than `start`.

    annealing_sweeps: sweeps of simulated annealing before, drawn from `seed`, 0 to 2^64 - 1; seconds_max: guard by the
    clock; threads: the answer is the same for any number; after_sweep: called after every sweep, True stops the search.
    KeyboardInterrupt stops the search after a sweep, the result shows it; any other exception is raised again.
    Raises ValueError for invalid options.
    """
    errors = [
        f"{name} is {value}; needs {wanted}"
        for name, value, wanted, is_meant in (
            ("sweeps_max", sweeps_max, "a whole number >= 0", sweeps_max >= 0),
            ("annealing_sweeps", annealing_sweeps, "a whole number >= 0", annealing_sweeps >= 0),
            ("seed", seed, "0 to 2^64 - 1", 0 <= seed < 2**64),
            ("seconds_max", seconds_max, "a time of at least 0 s", seconds_max >= 0.0),
            ("threads", threads, "at least 1", threads >= 1),
        )
        if not is_meant
    ]
    if errors:
        raise ValueError("; ".join(errors))
    plan = _droplets(problem, start)
    report, asked = ReportStruct(), AfterSweep(after_sweep)
    options = SearchOptionsStruct(
        int(moves), annealing_sweeps, sweeps_max, seed, seconds_max, threads, asked.callback, None
    )
    code = answered(library().inkloop_search(problem_struct(problem), options, pointer(plan), report))
    return _result(plan, report, code, asked.was_interrupted())


def paper_search(problem: HorizonProblem, start: IntPlan, batch: int, iterations_max: int, seed: int) -> SearchResult:
    """Improve a plan of one layer by the stochastic greedy search of Lu, Zheng, Mishra (2015, IV-C).

    batch: flips tried before those that help are made together, >= 1 (their M); iterations_max: batches; seed >= 0.
    Raises ValueError for a longer horizon, and where a cell may choose between kinds of droplets.
    """
    if batch < 1 or seed < 0:
        raise ValueError(f"batch is {batch} and seed {seed}; needs a batch of at least 1 cell and a seed >= 0")
    if problem.layers > 1 or (problem.choices & (problem.choices - 1)).any():
        raise ValueError(
            f"choices holds {problem.layers} layers with up to {np.bitwise_count(problem.choices).max()} kinds on a "
            "cell; the paper's search needs 1 layer and at most 1 kind"
        )
    plan = _droplets(problem, start)
    report = ReportStruct()
    code = library().inkloop_paper_search(problem_struct(problem), pointer(plan), batch, iterations_max, seed, report)
    return _result(plan, report, answered(code), False)


def layer(
    height: FloatMap, pattern: IntMap, inks: Sequence[Ink], order: Sequence[int] = (), factor: FloatMap | None = None
) -> FloatMap:
    """Surface after one layer (Lu, Zheng, Mishra 2015, eq. 3-7), open edge.

    height: (nx, ny) [m]; pattern: (nx, ny), 0 none, 1 + index of the ink; order: colours 2 (i % 2) + j % 2 of the four
    passes, each on the surface that the last one left (empty: one pass); factor: (nx, ny) volume of each droplet [1].
    """
    shape = np.shape(height)
    before = checked("height", height, "f8", shape)
    droplets = checked("pattern", pattern, "i4", shape)
    if droplets.size and (droplets.min() < 0 or droplets.max() > len(inks)):
        raise ValueError(f"pattern holds {droplets.min()} to {droplets.max()}; needs 0 to {len(inks)}, the inks given")
    if len(order) and sorted(order) != [0, 1, 2, 3]:
        raise ValueError(f"order is {list(order)}; needs each of the colours 0 to 3 once")
    colours = (ctypes.c_int32 * 4)(*order)
    factors = None if factor is None else checked("factor", factor, "f8", shape)
    scratch, after = np.empty(shape), np.empty(shape)
    library().inkloop_layer(
        *shape,
        pointer(before),
        pointer(droplets),
        ink_pair(inks),
        None if factors is None else pointer(factors),
        4 if len(order) else 1,
        colours,
        pointer(scratch),
        pointer(after),
    )
    return after


def split(layer: IntMap, inks: int) -> tuple[IntMap, IntMap]:
    """A layer of a plan (nx, ny) as pattern, 0 none, 1 material A, 2 material B, and drops per site, 1 for none."""
    droplets = laid_out("layer", layer, "i4", np.shape(layer))
    pattern, level = np.empty(layer.shape, np.int32), np.empty(layer.shape, np.int32)
    library().inkloop_pattern(pointer(droplets), layer.size, inks, pointer(pattern), pointer(level))
    return pattern, level


def problem_struct(problem: HorizonProblem) -> ProblemStruct:
    """The problem for C; its arrays must stay alive as long."""
    kinds = [InkStruct(kind.h1, kind.h2, kind.h3) for kind in problem.kinds]
    orders = [(ctypes.c_int32 * 4)(*order) for order in problem.colours]
    return ProblemStruct(
        *problem.height.shape,
        problem.layers,
        pointer(problem.height),
        pointer(problem.target),
        None if problem.ceiling is None else pointer(problem.ceiling),
        pointer(problem.part),
        None if problem.weight is None else pointer(problem.weight),
        pointer(problem.choices),
        len(kinds),
        (InkStruct * KINDS_MAX)(*kinds),
        problem.alpha,
        problem.overshoot,
        problem.ceiling_cost,
        problem.droplet_std,
        problem.passes,
        (ctypes.c_int32 * 4 * HORIZON_MAX)(*orders),
    )


def _droplets(problem: HorizonProblem, plan: IntPlan) -> IntPlan:
    """A copy of a plan that C may write to, with droplets of the kinds that may fall on their cells only."""
    droplets = np.array(checked("plan", plan, "i4", problem.choices.shape))
    if droplets.min() < 0 or droplets.max() > len(problem.kinds):
        raise ValueError(
            f"plan holds {droplets.min()} to {droplets.max()}; needs 0 to {len(problem.kinds)}, the kinds given"
        )
    forbidden = (2 * problem.choices.astype(np.int32) + 1) >> droplets & 1 == 0
    if forbidden.any():
        cell = first_cell(forbidden)
        raise ValueError(
            f"plan has a droplet of kind {droplets[cell] - 1} at cell {cell[1:]} of layer {cell[0]}, where the choices "
            "do not allow it"
        )
    return droplets


def _result(plan: IntPlan, report: ReportStruct, code: int, interrupted: bool) -> SearchResult:
    counts = (report.sweeps, report.evaluations, report.flips, report.swaps, report.shifts)
    status = SearchStatus(code)
    return SearchResult(plan, objective_of(report.objective), report.incremental, status, *counts, interrupted)


def objective_of(found: ObjectiveStruct) -> Objective:
    """An objective from C."""
    return Objective(found.value, found.error, found.over_ceiling, found.deviation)


def answered(code: int) -> int:
    if code == _NO_MEMORY:
        raise MemoryError("no memory for the search of a plan; it takes about 40 bytes per cell and 10 more per step")
    if code == _NO_SCAN:
        raise ValueError(
            "the first scan has readings on less than 2 % of the cells; needs one of the surface to print on: look at "
            "the sensor"
        )
    return code


def checked(name: str, array: NDArray[Any], dtype: str, shape: Sequence[int]) -> NDArray[Any]:
    """The array in C order; it must have shape and dtype already, and finite values."""
    error = error_of_array(name, array, dtype, shape)
    if error:
        raise ValueError(error)
    return np.ascontiguousarray(array)


def laid_out(name: str, array: NDArray[Any], dtype: str, shape: Sequence[int]) -> NDArray[Any]:
    """The same of values that are known to be finite: to look at them takes longer than the rest."""
    error = error_of_layout(name, array, dtype, shape)
    if error:
        raise ValueError(error)
    return np.ascontiguousarray(array)


def ink_pair(inks: Sequence[Ink]) -> ctypes.Array[InkStruct]:
    both = (inks[0], inks[-1])
    return (InkStruct * 2)(*(InkStruct(ink.h1, ink.h2, ink.h3) for ink in both))


_C_ARRAYS: dict[np.dtype[Any], Any] = {  # of one element
    np.dtype(np.float64): ctypes.c_double * 1,
    np.dtype(np.int32): ctypes.c_int32 * 1,
    np.dtype(np.int64): ctypes.c_int64 * 1,
    np.dtype(np.uint16): ctypes.c_uint16 * 1,
    np.dtype(np.bool_): ctypes.c_uint8 * 1,
    np.dtype(np.uint8): ctypes.c_uint8 * 1,
}


def pointer(array: NDArray[Any]) -> Any:
    """For C the address of the first element of the array, which it keeps alive."""
    c_array = _C_ARRAYS[array.dtype]
    if array.size and array.flags.writeable:
        return c_array.from_buffer(array)  # a quarter of the time of the general way
    return array.ctypes.data_as(ctypes.POINTER(c_array._type_))
