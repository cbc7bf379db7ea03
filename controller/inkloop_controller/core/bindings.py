"""The search core from Python: arrays in, arrays out, every array checked before C sees it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from inkloop.component import FloatMap, Ink
from inkloop_controller.core.library import (
    AFTER_SWEEP,
    CORE_DONE,
    CORE_NO_DEVICE,
    CORE_NO_MEMORY,
    CORE_NO_SCAN,
    CORE_STOPPED,
    DEVICE_SEARCH,
    ObjectiveStruct,
    ReportStruct,
    ink_pair,
    library,
    problem_struct,
)
from inkloop_controller.problem.arrays import checked, checked_droplets, first_cell, pointer
from inkloop_controller.problem.horizon_problem import HorizonProblem, IntMap, IntPlan, Objective, SearchProgress


class SearchResult(NamedTuple):
    """A plan (layers, nx, ny) with its objective; is_done: no single change that is tried improves it."""

    plan: IntPlan
    objective: Objective
    is_done: bool
    progress: SearchProgress


def objective(problem: HorizonProblem, plan: IntPlan) -> Objective:
    """Objective of a plan (layers, nx, ny)."""
    droplets = droplets_of(problem, plan)
    found = ObjectiveStruct()
    answered(library().inkloop_objective(problem_struct(problem), pointer(droplets), found))
    return objective_of(found)


def paper_search(problem: HorizonProblem, start: IntPlan, batch: int, iterations_max: int, seed: int) -> SearchResult:
    """Improve a plan by the stochastic greedy search of Lu, Zheng, Mishra (2015, IV-C), who plan one layer.

    batch: flips tried before those that help are made together, >= 1 (their M); iterations_max: batches; seed >= 0.
    Raises ValueError where a cell may choose between kinds of droplets.
    """
    if batch < 1 or seed < 0:
        raise ValueError(f"batch is {batch} and seed {seed}; needs a batch of at least 1 cell and a seed >= 0")
    kinds = np.bitwise_count(problem.choices).max()
    if kinds > 1:
        raise ValueError(f"choices holds up to {kinds} kinds on a cell; the paper's search needs at most 1 kind")
    plan, report = droplets_of(problem, start), ReportStruct()
    code = library().inkloop_paper_search(problem_struct(problem), pointer(plan), batch, iterations_max, seed, report)
    return SearchResult(plan, objective_of(report.objective), answered(code) == CORE_DONE, progress_of(report))


def layer(
    height: FloatMap, pattern: IntMap, inks: Sequence[Ink], order: Sequence[int] = (), factor: FloatMap | None = None
) -> FloatMap:
    """Surface after one layer (Lu, Zheng, Mishra 2015, eq. 3-7), open edge.

    height: (nx, ny) [m]; pattern: (nx, ny), 0 none, 1 + index of the ink; order: colours 2 (i % 2) + j % 2 of the four
    passes, each on the surface that the last one left (empty: one pass); factor: (nx, ny) volume of each droplet [1].
    """
    shape = np.shape(height)
    before = checked("height", height, "f8", shape)
    droplets, volumes = checked_droplets(pattern, factor, shape, len(inks))
    if len(order) and sorted(order) != [0, 1, 2, 3]:
        raise ValueError(f"order is {list(order)}; needs each of the colours 0 to 3 once")
    colours = np.array(order if len(order) else range(4), np.int32)
    factors = None if volumes is None else pointer(volumes)
    passes = 4 if len(order) else 1
    scratch, after = np.empty(shape), np.empty(shape)
    maps = (pointer(before), pointer(droplets), ink_pair(inks), factors, passes, pointer(colours))
    library().inkloop_layer(*shape, *maps, pointer(scratch), pointer(after))
    return after


def split(layer: IntMap, inks: int) -> tuple[IntMap, IntMap]:
    """A layer of a plan (nx, ny) as pattern, 0 none, 1 material A, 2 material B, and drops per site, 1 for none."""
    droplets = checked("layer", layer, "i4", np.shape(layer))
    pattern, level = np.empty(layer.shape, np.int32), np.empty(layer.shape, np.int32)
    library().inkloop_pattern(pointer(droplets), layer.size, inks, pointer(pattern), pointer(level))
    return pattern, level


def diffuse(problem: HorizonProblem, droplets: FloatMap) -> IntPlan:
    """A plan with nearly the same number of droplets around every cell, the last layers filled first.

    droplets: (layers, nx, ny), of any size. A full layer flows into the gaps that a partial one left below.
    """
    given = checked("droplets", droplets, "f8", problem.choices.shape)
    plan = np.empty(given.shape, np.int32)
    answered(library().inkloop_diffuse(problem_struct(problem), pointer(given), pointer(plan)))
    return plan


class Device(Protocol):
    """A search elsewhere, as that of the core (DeviceSearch in controller/core/problem/horizon_problem.h)."""

    def improve(self, problem: Any, options: Any, plan: IntPlan, after_sweep: Callable[[int], bool]) -> tuple[int, int]:
        """Improve a plan (layers, nx, ny) in place; a CORE_... and the number of sweeps.

        problem, options: HorizonProblem and SearchOptions of C; after_sweep: takes the sweeps made, True stops here.
        """


class Calls:
    """Calls from the core. An exception must not pass through C: it stops the search, and is kept.

    after_sweep: `wanted` sees each sweep, True stops the search. It is needed without `wanted` too: Python sees Ctrl-C
    only while it runs.
    """

    def __init__(self, wanted: Callable[[SearchProgress], bool] | None = None, device: Device | None = None) -> None:
        self._wanted, self._device = wanted, device
        self._raised: BaseException | None = None
        self.after_sweep = AFTER_SWEEP(self._ask)
        self.device = DEVICE_SEARCH(self._repair) if device else DEVICE_SEARCH()

    def was_interrupted(self) -> bool:
        """Whether Ctrl-C has stopped the search; any other exception is raised now."""
        if self._raised is None or isinstance(self._raised, KeyboardInterrupt):
            return self._raised is not None
        raise self._raised

    def _ask(self, _: int | None, so_far: Any) -> int:
        try:
            return int(self._wanted is not None and bool(self._wanted(progress_of(so_far.contents))))
        except BaseException as error:
            self._raised = error
            return 1

    def _repair(self, problem: Any, options: Any, plan: Any, report: Any) -> int:
        found, given = report.contents, problem.contents

        def ask(sweeps: int) -> bool:
            found.sweeps = sweeps
            return self._ask(None, report) != 0

        try:
            assert self._device
            droplets = np.ctypeslib.as_array(plan, (given.layers, given.nx, given.ny))
            code, found.sweeps = self._device.improve(given, options.contents, droplets, ask)
            return code
        except BaseException as error:
            self._raised = error
            return CORE_STOPPED if isinstance(error, KeyboardInterrupt) else CORE_NO_DEVICE


def droplets_of(problem: HorizonProblem, plan: IntPlan) -> IntPlan:
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


def progress_of(report: Any) -> SearchProgress:
    """Progress of a search, from C."""
    counts = (report.sweeps, report.evaluations, report.flips, report.swaps, report.shifts)
    return SearchProgress(report.objective.value, *counts)


def objective_of(found: Any) -> Objective:
    """An objective from C."""
    return Objective(found.value, found.error, found.over_ceiling, found.deviation)


def answered(code: int) -> int:
    """The code that C has returned. Raises MemoryError where it had none, ValueError for no scan."""
    if code == CORE_NO_MEMORY:
        raise MemoryError("no memory for the search of a plan; it takes about 40 bytes per cell and 10 more per step")
    if code == CORE_NO_SCAN:
        raise ValueError(
            "the first scan has readings on less than 2 % of the cells; needs one of the surface to print on: look at "
            "the sensor"
        )
    return code
