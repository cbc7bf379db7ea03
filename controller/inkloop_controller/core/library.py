"""Load the C search core and declare its entry points for ctypes (controller/core/inkloop_core.h)."""

from __future__ import annotations

import ctypes
from functools import cache

from inkloop.files import c_library
from inkloop_controller.core.structs import (
    INTEGERS,
    MARKS,
    REALS,
    EstimateStruct,
    EstimatorOptionsStruct,
    FiguresStruct,
    FinishStruct,
    InkRegionsStruct,
    InkStruct,
    JettedLayerStruct,
    ObjectiveStruct,
    PlanReportStruct,
    PlanWorkStruct,
    ProblemStruct,
    RelaxationOptionsStruct,
    RelaxationReportStruct,
    ReportStruct,
    SearchOptionsStruct,
)

VARIABLE = "INKLOOP_CORE_LIB"
_INTERFACE = 16  # CORE_INTERFACE of inkloop_core.h
_GRID = (ctypes.c_size_t, ctypes.c_size_t)


_PROBLEM = ctypes.POINTER(ProblemStruct)
_ESTIMATOR = ctypes.POINTER(EstimatorOptionsStruct)
_ESTIMATE = ctypes.POINTER(EstimateStruct)
_LAYER = ctypes.POINTER(JettedLayerStruct)
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
    "inkloop_ink_choices": (
        None,
        (ctypes.POINTER(InkRegionsStruct), ctypes.c_size_t, REALS, ctypes.c_size_t, INTEGERS),
    ),
    "inkloop_finish": (None, (ctypes.c_int32, ctypes.POINTER(FinishStruct))),
    "inkloop_relax": (
        ctypes.c_int32,
        (_PROBLEM, ctypes.POINTER(RelaxationOptionsStruct), REALS, ctypes.POINTER(RelaxationReportStruct)),
    ),
    "inkloop_relaxed_gradient": (ctypes.c_int32, (_PROBLEM, REALS, ctypes.c_double, REALS, REALS)),
    "inkloop_diffuse": (ctypes.c_int32, (_PROBLEM, REALS, INTEGERS)),
    "inkloop_knowledge_size": (ctypes.c_size_t, ()),
    "inkloop_estimate_first": (ctypes.c_int32, (_ESTIMATOR, ctypes.c_int32, REALS, MARKS, _ESTIMATE)),
    "inkloop_estimate_next": (
        ctypes.c_int32,
        (_ESTIMATOR, _ESTIMATE, _LAYER, ctypes.c_int32, ctypes.c_int32, REALS, MARKS, _ESTIMATE),
    ),
    "inkloop_estimate_figures": (None, (_ESTIMATOR, _ESTIMATE, ctypes.POINTER(FiguresStruct))),
    "inkloop_trust_again": (None, (_ESTIMATE, ctypes.c_size_t)),
}


@cache
def library() -> ctypes.CDLL:
    """The loaded search core. Raises InkloopError if it is not installed or cannot be loaded."""
    return c_library("inkloop_controller", "inkloop_core", VARIABLE, _INTERFACE, _ENTRY_POINTS)
