"""The C search core: its structures and entry points (controller/core/inkloop_core.h), and the loaded library."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from ctypes import POINTER, c_double, c_int32, c_int64, c_size_t, c_uint8, c_uint16, c_uint64, c_void_p
from functools import cache
from typing import Any

from inkloop.component import Ink
from inkloop.files import c_library
from inkloop_controller.problem.arrays import pointer
from inkloop_controller.problem.horizon_problem import HORIZON_MAX, KINDS_MAX, HorizonProblem

VARIABLE = "INKLOOP_CORE_LIB"
_INTERFACE = 19  # CORE_INTERFACE of inkloop_core.h


def structure(name: str, *fields: tuple[Any, str]) -> Any:
    """The structure of this name in the headers of controller/core: types, each with the names of its fields."""
    declared = [(field, kind) for kind, names in fields for field in names.split()]
    return type(name, (ctypes.Structure,), {"_fields_": declared})


_REALS, _INTEGERS, _MARKS, _CHOICES = POINTER(c_double), POINTER(c_int32), POINTER(c_uint8), POINTER(c_uint16)
_BLOCK = _MARKS  # a state, or an estimate

InkStruct = structure("Ink", (c_double, "h1 h2 h3"))
ProblemStruct = structure(
    "HorizonProblem",
    (c_size_t, "nx ny layers"),
    (_REALS, "height target ceiling"),
    (_MARKS, "part"),
    (_REALS, "weight"),
    (_CHOICES, "choices"),
    (c_size_t, "kinds"),
    (InkStruct * KINDS_MAX, "kind"),
    (c_double, "alpha overshoot ceiling_cost droplet_std"),
    (c_int32, "passes"),
    (c_int32 * 4 * HORIZON_MAX, "colours"),
)
ObjectiveStruct = structure("Objective", (c_double, "value error over_ceiling deviation"))
ReportStruct = structure(
    "SearchReport",
    (ObjectiveStruct, "objective"),
    (c_double, "incremental"),
    (c_int64, "sweeps evaluations flips swaps shifts"),
)
AFTER_SWEEP = ctypes.CFUNCTYPE(c_int32, c_void_p, POINTER(ReportStruct))
SearchOptionsStruct = structure(
    "SearchOptions",
    (c_int32, "moves"),
    (c_int64, "annealing_sweeps sweeps_max"),
    (c_uint64, "seed"),
    (c_double, "seconds_max"),
    (c_int32, "threads"),
    (AFTER_SWEEP, "after_sweep"),
    (c_void_p, "caller"),
)
DEVICE_SEARCH = ctypes.CFUNCTYPE(
    c_int32, POINTER(ProblemStruct), POINTER(SearchOptionsStruct), _INTEGERS, POINTER(ReportStruct)
)
CORE_DONE, CORE_BUDGET, CORE_TIME, CORE_STOPPED, CORE_NO_MEMORY, CORE_NO_SCAN, CORE_NO_DEVICE = range(7)
FinishStruct = structure("Finish", (c_int32, "horizon foreign_horizon"), (c_double, "layer_worth"))
PlanReportStruct = structure(
    "PlanReport",
    (c_int32, "status start is_annealed left_out"),
    (c_int64, "sweeps"),
    (ObjectiveStruct, "objective nothing"),
    (c_double, "evaluation"),
    (c_double * 3, "seconds"),
)
PlanFiguresStruct = structure(
    "PlanFigures",
    (c_int32, "status left_out"),
    (c_int64, "sweeps"),
    (ObjectiveStruct, "objective"),
    (c_double, "bound bound_confidence seconds"),
)
StepStruct = structure(
    "LayerStep",
    (c_void_p, "values"),
    (POINTER(c_int64), "region_offsets"),
    (_REALS, "region_bottoms region_tops"),
    (c_int32, "threads take_as_read"),
)
SurfaceStruct = structure(
    "SurfaceToPlan",
    (_REALS, "height variance"),
    (_MARKS, "dead capped"),
    (InkStruct * 2, "ink"),
    (c_double, "droplet_std"),
    (c_int32, "is_foreign"),
)
ProblemMapsStruct = structure("ProblemMaps", (_REALS, "ceiling weight"), (_CHOICES, "choices"))

_PROBLEM, _STEP = POINTER(ProblemStruct), POINTER(StepStruct)
_REPORT, _PLANNED, _FIGURES = POINTER(ReportStruct), POINTER(PlanReportStruct), POINTER(PlanFiguresStruct)
_RESULT = c_int32  # CORE_... of horizon_problem.h
_ENTRY_POINTS: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "layer": (
        c_double,
        (c_size_t, c_size_t, _REALS, _INTEGERS, POINTER(InkStruct), _REALS, c_int32, _INTEGERS, _REALS, _REALS),
    ),
    "objective": (_RESULT, (_PROBLEM, _INTEGERS, POINTER(ObjectiveStruct))),
    "paper_search": (_RESULT, (_PROBLEM, _INTEGERS, c_int64, c_int64, c_uint64, _REPORT)),
    "diffuse": (_RESULT, (_PROBLEM, _REALS, _INTEGERS)),
    "pattern": (None, (_INTEGERS, c_size_t, c_int32, _INTEGERS, _INTEGERS)),
    "finish": (None, (c_int32, POINTER(FinishStruct))),
    "variables": (c_size_t, ()),
    "estimate_size": (c_size_t, (c_size_t,)),
    "knowledge_size": (c_size_t, ()),
    "estimate_first": (_RESULT, (_STEP, c_int32, _REALS, _MARKS, _BLOCK)),
    "estimate_next": (_RESULT, (_STEP, _BLOCK, _INTEGERS, _REALS, c_int32, c_int32, _REALS, _MARKS, _BLOCK)),
    "estimate_figures": (None, (_STEP, _BLOCK, c_void_p, _MARKS)),
    "trust_again": (None, (_BLOCK, c_size_t)),
    "state_head_size": (c_size_t, ()),
    "state_size": (c_size_t, (c_size_t, c_size_t)),
    "state_layers": (c_size_t, (_STEP, _BLOCK, c_size_t)),
    "state_start": (None, (_STEP, c_size_t, c_int32, _BLOCK)),
    "state_plan": (None, (_BLOCK, _FIGURES)),
    "step_is_due": (c_int32, (_STEP, _BLOCK)),
    "step_begin": (c_int32, (_STEP, _BLOCK, _BLOCK)),
    "step_take": (None, (_STEP, _BLOCK, _INTEGERS, c_size_t, _FIGURES, _BLOCK)),
    "step_outputs": (None, (_STEP, _BLOCK)),
    "layer_problem": (None, (_STEP, POINTER(SurfaceStruct), c_int32, POINTER(ProblemMapsStruct), _PROBLEM)),
    "plan": (
        _RESULT,
        (
            *(_STEP, c_int32, _PROBLEM, c_int32, _REALS, _INTEGERS, c_size_t, c_double, DEVICE_SEARCH, AFTER_SWEEP),
            *(_INTEGERS, _PLANNED),
        ),
    ),
}


@cache
def library() -> ctypes.CDLL:
    """The loaded search core. Raises InkloopError if it is not installed or cannot be loaded."""
    entry_points = {f"inkloop_{name}": types for name, types in _ENTRY_POINTS.items()}
    return c_library("inkloop_controller", "inkloop_core", VARIABLE, _INTERFACE, entry_points)


def problem_struct(problem: HorizonProblem) -> Any:
    """The problem for C; its arrays must stay alive as long."""
    maps = {name: getattr(problem, name) for name in ("height", "target", "ceiling", "part", "weight", "choices")}
    nx, ny = problem.height.shape
    return ProblemStruct(
        nx=nx,
        ny=ny,
        layers=problem.layers,
        kinds=len(problem.kinds),
        kind=tuple((kind.h1, kind.h2, kind.h3) for kind in problem.kinds),
        passes=problem.passes,
        colours=problem.colours,
        **{name: pointer(map_) for name, map_ in maps.items() if map_ is not None},
        **{name: getattr(problem, name) for name in ("alpha", "overshoot", "ceiling_cost", "droplet_std")},
    )


def ink_pair(inks: Sequence[Ink]) -> Any:
    """The inks for C: always two."""
    return (InkStruct * 2)(*((ink.h1, ink.h2, ink.h3) for ink in (inks[0], inks[-1])))
