"""The search core from Python: arrays in, arrays out, every array checked before C sees it."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap, FloatMap, Ink
from inkloop_controller.core_library import InkStruct, ProblemStruct, ReportStruct, library

IntMap: TypeAlias = NDArray[np.int32]
"""(nx, ny): a pattern (0 none, 1 material A, 2 material B), or the material of each cell (0 is A, 1 is B)."""

_BUDGET, _NO_MEMORY = 1, 2


@dataclass(frozen=True)
class LayerProblem:
    """Which of the allowed cells get a droplet in the coming layer, so that the surface comes close to the target.

    height, target: (nx, ny) [m]; part: cells that count in the objective; allowed: cells that may get a droplet;
    material: (nx, ny), index into `inks` of a droplet on the cell; alpha: weight of the mean error against the
    standard deviation (Lu, Zheng, Mishra 2015, eq. 8). Raises ValueError if a value cannot be meant.
    """

    height: FloatMap
    target: FloatMap
    part: BoolMap
    allowed: BoolMap
    material: IntMap
    inks: tuple[Ink, ...]
    alpha: float

    def __post_init__(self) -> None:
        shape = np.shape(self.height)
        if len(shape) != 2 or 0 in shape:
            raise ValueError(f"height has shape {shape}; a layer problem needs (nx, ny) with at least one cell")
        for name, dtype in (("height", "f8"), ("target", "f8"), ("part", "?"), ("allowed", "?"), ("material", "i4")):
            object.__setattr__(self, name, _checked(name, getattr(self, name), dtype, shape))
        if not self.part.any():
            raise ValueError("part marks no cell; an objective over no cell means nothing")
        if not 1 <= len(self.inks) <= 2 or self.material.min() < 0 or self.material.max() >= len(self.inks):
            raise ValueError(
                f"material runs from {self.material.min()} to {self.material.max()} with {len(self.inks)} inks; "
                "needs 1 or 2 inks and materials that name one of them, counted from 0"
            )
        if not 0.0 <= self.alpha <= 1.0:
            raise ValueError(f"alpha is {self.alpha}; needs a weight between 0 and 1")

    def _struct(self) -> ProblemStruct:
        return ProblemStruct(
            *self.height.shape,
            _pointer(self.height),
            _pointer(self.target),
            _pointer(self.part, ctypes.c_uint8),
            _pointer(self.allowed, ctypes.c_uint8),
            _pointer(self.material),
            _ink_pair(self.inks),
            self.alpha,
        )


@dataclass(frozen=True)
class SearchResult:
    """A pattern with its objective [m], evaluated from scratch; `incremental` as the running sums had it [m].

    finished: no single change improves the pattern (else the work budget ended first).
    """

    pattern: IntMap
    objective: float
    incremental: float
    finished: bool
    sweeps: int
    flips: int
    swaps: int
    evaluations: int


def objective(problem: LayerProblem, pattern: IntMap) -> float:
    """Objective [m] of a pattern (not 0: a droplet of the cell's own material)."""
    droplets = _droplets(problem, pattern)
    value = ctypes.c_double()
    _answered(library().inkloop_objective(problem._struct(), _pointer(droplets), value))
    return value.value


def search(
    problem: LayerProblem, start: IntMap, sweeps_max: int, *, annealing_sweeps: int = 0, seed: int = 0
) -> SearchResult:
    """Improve a pattern by flips and swaps until neither helps, or for `sweeps_max` sweeps; the result is never worse.

    annealing_sweeps: sweeps of simulated annealing before (they may end worse than `start`), drawn from `seed` >= 0.
    """
    pattern = _droplets(problem, start)
    report = ReportStruct()
    struct = problem._struct()
    code = library().inkloop_search(struct, _pointer(pattern), annealing_sweeps, sweeps_max, seed, report)
    return _result(pattern, report, _answered(code))


def paper_search(problem: LayerProblem, start: IntMap, batch: int, iterations_max: int, seed: int) -> SearchResult:
    """Improve a pattern by the stochastic greedy search of Lu, Zheng, Mishra (2015, IV-C).

    batch: flips tried before those that help are made together, >= 1 (their M); iterations_max: batches; seed >= 0.
    """
    if batch < 1 or seed < 0:
        raise ValueError(f"batch is {batch} and seed {seed}; needs a batch of at least 1 cell and a seed >= 0")
    pattern = _droplets(problem, start)
    report = ReportStruct()
    struct = problem._struct()
    code = library().inkloop_paper_search(struct, _pointer(pattern), batch, iterations_max, seed, report)
    return _result(pattern, report, _answered(code))


def layer(
    height: FloatMap, pattern: IntMap, inks: Sequence[Ink], order: Sequence[int] = (), factor: FloatMap | None = None
) -> FloatMap:
    """Surface after one layer (Lu, Zheng, Mishra 2015, eq. 3-7), open edge.

    height: (nx, ny) [m]; pattern: (nx, ny), 0 none, 1 + index of the ink; order: colours 2 (i % 2) + j % 2 of the four
    passes, each on the surface that the last one left (empty: one pass); factor: (nx, ny) volume of each droplet [1].
    """
    shape = np.shape(height)
    before = _checked("height", height, "f8", shape)
    droplets = _checked("pattern", pattern, "i4", shape)
    if droplets.size and (droplets.min() < 0 or droplets.max() > len(inks)):
        raise ValueError(f"pattern holds {droplets.min()} to {droplets.max()}; needs 0 to {len(inks)}, the inks given")
    if len(order) and sorted(order) != [0, 1, 2, 3]:
        raise ValueError(f"order is {list(order)}; needs each of the colours 0 to 3 once")
    colours = (ctypes.c_int32 * 4)(*order)
    factors = None if factor is None else _checked("factor", factor, "f8", shape)
    scratch, after = np.empty(shape), np.empty(shape)
    library().inkloop_layer(
        *shape,
        _pointer(before),
        _pointer(droplets),
        _ink_pair(inks),
        None if factors is None else _pointer(factors),
        4 if len(order) else 1,
        colours,
        _pointer(scratch),
        _pointer(after),
    )
    return after


def _checked(name: str, array: NDArray[Any], dtype: str, shape: tuple[int, ...]) -> NDArray[Any]:
    """The array in C order; it must have shape and dtype already, and finite values."""
    if np.shape(array) != shape:
        raise ValueError(f"{name} has shape {np.shape(array)}; needs {shape}")
    if array.dtype != np.dtype(dtype):
        raise ValueError(f"{name} has dtype {array.dtype}; needs {np.dtype(dtype)}")
    if dtype == "f8" and not np.isfinite(array).all():
        cell = tuple(int(index) for index in np.argwhere(~np.isfinite(array))[0])
        raise ValueError(f"{name} is {array[cell]} at cell {cell}; needs finite values")
    return np.ascontiguousarray(array)


def _droplets(problem: LayerProblem, pattern: IntMap) -> IntMap:
    """A copy of a pattern that C may write to, with droplets on allowed cells only."""
    droplets = np.array(_checked("pattern", pattern, "i4", problem.height.shape))
    if (droplets[~problem.allowed] != 0).any():
        cell = tuple(int(index) for index in np.argwhere((droplets != 0) & ~problem.allowed)[0])
        raise ValueError(f"pattern has a droplet at cell {cell}, where none is allowed")
    return droplets


def _result(pattern: IntMap, report: ReportStruct, code: int) -> SearchResult:
    counts = (report.sweeps, report.flips, report.swaps, report.evaluations)
    return SearchResult(pattern, report.objective, report.incremental, code != _BUDGET, *counts)


def _answered(code: int) -> int:
    if code == _NO_MEMORY:
        raise MemoryError("no memory for the search of a layer; it takes about 100 bytes per cell")
    return code


def _ink_pair(inks: Sequence[Ink]) -> ctypes.Array[InkStruct]:
    both = (inks[0], inks[-1])
    return (InkStruct * 2)(*(InkStruct(ink.h1, ink.h2, ink.h3) for ink in both))


def _pointer(array: NDArray[Any], kind: type[Any] | None = None) -> Any:
    """A ctypes pointer to the array, which it keeps alive."""
    c_type = kind or {"f8": ctypes.c_double, "i4": ctypes.c_int32}[array.dtype.str[1:]]
    return array.ctypes.data_as(ctypes.POINTER(c_type))
