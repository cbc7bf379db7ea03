"""Load the C search core and declare its entry points for ctypes (controller/core/inkloop_core.h)."""

from __future__ import annotations

import ctypes
import os
import sys
import sysconfig
from collections.abc import Iterator
from functools import cache
from importlib.resources import files
from pathlib import Path

from inkloop.errors import InkloopError
from inkloop_controller.core.structs import (
    INTEGERS,
    MARKS,
    REALS,
    EstimateStruct,
    EstimatorOptionsStruct,
    FinishStruct,
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
_INTERFACE = 6  # CORE_INTERFACE of inkloop_core.h
_PACKAGE = "inkloop_controller"
_GRID = (ctypes.c_size_t, ctypes.c_size_t)


_PROBLEM = ctypes.POINTER(ProblemStruct)
_ESTIMATOR = ctypes.POINTER(EstimatorOptionsStruct)
_ESTIMATE = ctypes.POINTER(EstimateStruct)
_LAYER = ctypes.POINTER(JettedLayerStruct)
_REPORT = ctypes.POINTER(ReportStruct)
_ENTRY_POINTS = {
    "inkloop_core_interface": (ctypes.c_int32, ()),
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
    "inkloop_no_registration": (None, (ctypes.POINTER(RegistrationStruct),)),
    "inkloop_displacement": (None, (ctypes.POINTER(RegistrationStruct), ctypes.POINTER(ScanDisplacementStruct))),
    "inkloop_untrusted_reasons": (ctypes.c_int32, (ctypes.POINTER(LoopTrustStruct),)),
    "inkloop_estimate_first": (ctypes.c_int32, (_ESTIMATOR, ctypes.c_int32, REALS, MARKS, _ESTIMATE)),
    **dict.fromkeys(
        ("inkloop_estimate_next", "inkloop_estimate_unknown"),
        (ctypes.c_int32, (_ESTIMATOR, _ESTIMATE, _LAYER, REALS, MARKS, _ESTIMATE)),
    ),
}


@cache
def library() -> ctypes.CDLL:
    """The loaded search core. Raises InkloopError if it is not installed or cannot be loaded."""
    path = _path()
    try:
        core = ctypes.CDLL(str(path))
        for name, (result, arguments) in _ENTRY_POINTS.items():
            function = getattr(core, name)
            function.restype, function.argtypes = result, arguments
    except (OSError, AttributeError) as error:
        raise InkloopError(
            f"{path}: is not the search core of this inkloop ({error}); install inkloop again"
        ) from error
    if core.inkloop_core_interface() != _INTERFACE:
        raise InkloopError(
            f"{path}: was built from other sources than this Python code; run make, or pip install again"
        )
    return core


def _path() -> Path:
    named = os.environ.get(VARIABLE)
    if named:
        if not Path(named).is_file():
            raise InkloopError(f"{VARIABLE} is {named!r}: no such file; unset it to take the installed search core")
        return Path(named)
    places = [folder / _file_name() for folder in _folders()]
    found = next((place for place in places if place.is_file()), None)
    if found is None:
        looked = ", ".join(str(place) for place in places)
        raise InkloopError(f"the search core is not installed (looked for {looked}); run make, or pip install inkloop")
    return found


def _folders() -> Iterator[Path]:
    """Package folders; an editable install leaves the sources in place and puts built files next to NumPy."""
    package = files(_PACKAGE)
    if isinstance(package, Path):
        yield package
    for scheme in ("platlib", "purelib"):
        yield Path(sysconfig.get_path(scheme)) / _PACKAGE


def _file_name() -> str:
    if sys.platform == "win32":
        return "inkloop_core.dll"
    return "libinkloop_core.dylib" if sys.platform == "darwin" else "libinkloop_core.so"
