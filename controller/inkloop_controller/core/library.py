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
    FinishStruct,
    InkRegionsStruct,
    InkStruct,
    JettedLayerStruct,
    LoopTrustStruct,
    ObjectiveStruct,
    PlanReportStruct,
    PlanWorkStruct,
    ProblemStruct,
    RegistrationStruct,
    RelaxationOptionsStruct,
    RelaxationReportStruct,
    ReportStruct,
    ScanDisplacementStruct,
    SearchOptionsStruct,
)

VARIABLE = "INKLOOP_CORE_LIB"
_INTERFACE = 15  # CORE_INTERFACE of inkloop_core.h
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
    "inkloop_no_registration": (None, (ctypes.POINTER(RegistrationStruct),)),
    "inkloop_displacement": (None, (ctypes.POINTER(RegistrationStruct), ctypes.POINTER(ScanDisplacementStruct))),
    "inkloop_untrusted_reasons": (ctypes.c_int32, (ctypes.POINTER(LoopTrustStruct),)),
    "inkloop_is_plant_foreign": (ctypes.c_int32, (ctypes.POINTER(LoopTrustStruct),)),
    "inkloop_droplet_std": (ctypes.c_double, (ctypes.POINTER(LoopTrustStruct),)),
    "inkloop_estimate_first": (ctypes.c_int32, (_ESTIMATOR, ctypes.c_int32, REALS, MARKS, _ESTIMATE)),
    **dict.fromkeys(
        ("inkloop_estimate_next", "inkloop_estimate_unknown"),
        (ctypes.c_int32, (_ESTIMATOR, _ESTIMATE, _LAYER, REALS, MARKS, _ESTIMATE)),
    ),
}


@cache
def library() -> ctypes.CDLL:
    """The loaded search core. Raises InkloopError if it is not installed or cannot be loaded."""
    return c_library("inkloop_controller", "inkloop_core", VARIABLE, _INTERFACE, _ENTRY_POINTS)
