"""Load the C search core and declare its entry points for ctypes (controller/core/inkloop_core.h)."""

from __future__ import annotations

import ctypes
from functools import cache

from inkloop.files import c_library
from inkloop_controller.core.structs import (
    INTEGERS,
    MARKS,
    REALS,
    FinishStruct,
    InkStruct,
    LayerStepStruct,
    ObjectiveStruct,
    PlanFiguresStruct,
    PlanReportStruct,
    PlanWorkStruct,
    ProblemMapsStruct,
    ProblemStruct,
    RelaxationOptionsStruct,
    RelaxationReportStruct,
    ReportStruct,
    SearchOptionsStruct,
    SurfaceToPlanStruct,
)

VARIABLE = "INKLOOP_CORE_LIB"
_INTERFACE = 17  # CORE_INTERFACE of inkloop_core.h
_GRID = (ctypes.c_size_t, ctypes.c_size_t)


_PROBLEM = ctypes.POINTER(ProblemStruct)
_STEP = ctypes.POINTER(LayerStepStruct)
_BLOCK = MARKS
_FIGURES = ctypes.POINTER(PlanFiguresStruct)
_REPORT = ctypes.POINTER(ReportStruct)
_ENTRY_POINTS = {
    "inkloop_layer": (
        ctypes.c_double,
        (*_GRID, REALS, INTEGERS, ctypes.POINTER(InkStruct), REALS, ctypes.c_int32, INTEGERS, REALS, REALS),
    ),
    "inkloop_objective": (ctypes.c_int32, (_PROBLEM, INTEGERS, ctypes.POINTER(ObjectiveStruct))),
    "inkloop_search": (
        ctypes.c_int32,
        (_PROBLEM, ctypes.POINTER(SearchOptionsStruct), INTEGERS, _REPORT),
    ),
    "inkloop_paper_search": (
        ctypes.c_int32,
        (_PROBLEM, INTEGERS, ctypes.c_int64, ctypes.c_int64, ctypes.c_uint64, _REPORT),
    ),
    "inkloop_plan": (
        ctypes.c_int32,
        (_PROBLEM, ctypes.POINTER(PlanWorkStruct), INTEGERS, ctypes.POINTER(PlanReportStruct)),
    ),
    "inkloop_finish": (None, (ctypes.c_int32, ctypes.POINTER(FinishStruct))),
    "inkloop_relax": (
        ctypes.c_int32,
        (_PROBLEM, ctypes.POINTER(RelaxationOptionsStruct), REALS, ctypes.POINTER(RelaxationReportStruct)),
    ),
    "inkloop_relaxed_gradient": (ctypes.c_int32, (_PROBLEM, REALS, ctypes.c_double, REALS, REALS)),
    "inkloop_diffuse": (ctypes.c_int32, (_PROBLEM, REALS, INTEGERS)),
    "inkloop_variables": (ctypes.c_size_t, ()),
    "inkloop_estimate_size": (ctypes.c_size_t, (ctypes.c_size_t,)),
    "inkloop_knowledge_size": (ctypes.c_size_t, ()),
    "inkloop_estimate_first": (ctypes.c_int32, (_STEP, ctypes.c_int32, REALS, MARKS, _BLOCK)),
    "inkloop_estimate_next": (
        ctypes.c_int32,
        (_STEP, _BLOCK, INTEGERS, REALS, ctypes.c_int32, ctypes.c_int32, REALS, MARKS, _BLOCK),
    ),
    "inkloop_estimate_figures": (None, (_STEP, _BLOCK, ctypes.c_void_p, MARKS)),
    "inkloop_trust_again": (None, (_BLOCK, ctypes.c_size_t)),
    "inkloop_state_head_size": (ctypes.c_size_t, ()),
    "inkloop_state_size": (ctypes.c_size_t, _GRID),
    "inkloop_state_layers": (ctypes.c_size_t, (_STEP, _BLOCK, ctypes.c_size_t)),
    "inkloop_state_start": (None, (_STEP, ctypes.c_size_t, ctypes.c_int32, _BLOCK)),
    "inkloop_state_plan": (None, (_BLOCK, _FIGURES)),
    "inkloop_step_is_due": (ctypes.c_int32, (_STEP, _BLOCK)),
    "inkloop_step_begin": (ctypes.c_int32, (_STEP, _BLOCK, _BLOCK)),
    "inkloop_step_take": (None, (_STEP, _BLOCK, INTEGERS, ctypes.c_size_t, _FIGURES, _BLOCK)),
    "inkloop_step_outputs": (None, (_STEP, _BLOCK)),
    "inkloop_layer_problem": (
        None,
        (_STEP, ctypes.POINTER(SurfaceToPlanStruct), ctypes.c_int32, ctypes.POINTER(ProblemMapsStruct), _PROBLEM),
    ),
    "inkloop_plan_work": (None, (_STEP, ctypes.c_int32, ctypes.POINTER(PlanWorkStruct))),
    "inkloop_pattern": (None, (INTEGERS, ctypes.c_size_t, ctypes.c_int32, INTEGERS, INTEGERS)),
}


@cache
def library() -> ctypes.CDLL:
    """The loaded search core. Raises InkloopError if it is not installed or cannot be loaded."""
    return c_library("inkloop_controller", "inkloop_core", VARIABLE, _INTERFACE, _ENTRY_POINTS)
