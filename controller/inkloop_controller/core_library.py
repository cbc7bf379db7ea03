"""Where the C search core is, and what its entry points look like to ctypes (controller/core/inkloop_core.h)."""

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
from inkloop_controller.horizon_problem import HORIZON_MAX, KINDS_MAX

VARIABLE = "INKLOOP_CORE_LIB"
_INTERFACE = 2  # CORE_INTERFACE of inkloop_core.h
_PACKAGE = "inkloop_controller"
SHARES_MAX = 6  # of ink_identification.h
_GRID = (ctypes.c_size_t, ctypes.c_size_t)
_REALS = ctypes.POINTER(ctypes.c_double)
_INTEGERS = ctypes.POINTER(ctypes.c_int32)
_MARKS = ctypes.POINTER(ctypes.c_uint8)
_CHOICES = ctypes.POINTER(ctypes.c_uint16)


class InkStruct(ctypes.Structure):
    """`Ink` of layer_map.h."""

    _fields_ = (("h1", ctypes.c_double), ("h2", ctypes.c_double), ("h3", ctypes.c_double))


class ProblemStruct(ctypes.Structure):
    """`HorizonProblem` of horizon_problem.h."""

    _fields_ = (
        ("nx", ctypes.c_size_t),
        ("ny", ctypes.c_size_t),
        ("layers", ctypes.c_size_t),
        ("height", _REALS),
        ("target", _REALS),
        ("ceiling", _REALS),
        ("part", _MARKS),
        ("weight", _REALS),
        ("choices", _CHOICES),
        ("kinds", ctypes.c_size_t),
        ("kind", InkStruct * KINDS_MAX),
        ("alpha", ctypes.c_double),
        ("overshoot", ctypes.c_double),
        ("ceiling_cost", ctypes.c_double),
        ("passes", ctypes.c_int32),
        ("colours", ctypes.c_int32 * 4 * HORIZON_MAX),
    )


class ObjectiveStruct(ctypes.Structure):
    """`Objective` of horizon_problem.h."""

    _fields_ = (
        ("value", ctypes.c_double),
        ("error", ctypes.c_double),
        ("over_ceiling", ctypes.c_double),
        ("deviation", ctypes.c_double),
    )


class ReportStruct(ctypes.Structure):
    """`SearchReport` of horizon_problem.h."""

    _fields_ = (
        ("objective", ObjectiveStruct),
        ("incremental", ctypes.c_double),
        ("sweeps", ctypes.c_int64),
        ("evaluations", ctypes.c_int64),
        ("flips", ctypes.c_int64),
        ("swaps", ctypes.c_int64),
        ("shifts", ctypes.c_int64),
    )


AFTER_SWEEP = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.POINTER(ReportStruct))


class SearchOptionsStruct(ctypes.Structure):
    """`SearchOptions` of horizon_problem.h."""

    _fields_ = (
        ("moves", ctypes.c_int32),
        ("annealing_sweeps", ctypes.c_int64),
        ("sweeps_max", ctypes.c_int64),
        ("seed", ctypes.c_uint64),
        ("seconds_max", ctypes.c_double),
        ("threads", ctypes.c_int32),
        ("after_sweep", AFTER_SWEEP),
        ("caller", ctypes.c_void_p),
    )


class PlanWorkStruct(ctypes.Structure):
    """`PlanWork` of horizon_planner.h."""

    _fields_ = (
        ("relaxation", ctypes.c_int32),
        ("relaxed", _REALS),
        ("last", _INTEGERS),
        ("last_layers", ctypes.c_size_t),
        ("layer_worth", ctypes.c_double),
        ("sweeps", ctypes.c_int64),
        ("annealing_sweeps", ctypes.c_int64),
        ("iterations", ctypes.c_int64),
        ("seed", ctypes.c_uint64),
        ("seconds_max", ctypes.c_double),
        ("threads", ctypes.c_int32),
        ("after_sweep", AFTER_SWEEP),
        ("caller", ctypes.c_void_p),
    )


class PlanReportStruct(ctypes.Structure):
    """`PlanReport` of horizon_planner.h."""

    _fields_ = (
        ("status", ctypes.c_int32),
        ("start", ctypes.c_int32),
        ("is_annealed", ctypes.c_int32),
        ("sweeps", ctypes.c_int64),
        ("objective", ObjectiveStruct),
        ("seconds", ctypes.c_double * 3),
    )


class RelaxationOptionsStruct(ctypes.Structure):
    """`RelaxationOptions` of horizon_problem.h."""

    _fields_ = (("iterations_max", ctypes.c_int64), ("seconds_max", ctypes.c_double))


class RelaxationReportStruct(ctypes.Structure):
    """`RelaxationReport` of horizon_problem.h."""

    _fields_ = (("value", ctypes.c_double), ("iterations", ctypes.c_int64))


class InkEvidenceStruct(ctypes.Structure):
    """`InkEvidence` of ink_identification.h."""

    _fields_ = (
        ("response", ctypes.c_double * SHARES_MAX**2),
        ("covariance", ctypes.c_double * SHARES_MAX**2),
        ("surplus", ctypes.c_double * SHARES_MAX),
    )


class InkPriorStruct(ctypes.Structure):
    """`InkPrior` of ink_identification.h."""

    _fields_ = (("inks", ctypes.c_size_t), ("nominal", InkStruct * 2), ("model", ctypes.c_int32))


class EstimatorOptionsStruct(ctypes.Structure):
    """`EstimatorOptions` of height_estimator.h."""

    _fields_ = (
        ("nx", ctypes.c_size_t),
        ("ny", ctypes.c_size_t),
        ("part", _MARKS),
        ("ink", InkPriorStruct),
        ("take_as_read", ctypes.c_int32),
        ("noise_variance", ctypes.c_double),
        ("steps_variance", ctypes.c_double),
        ("first_variance", ctypes.c_double),
    )


class EstimateStruct(ctypes.Structure):
    """`SurfaceEstimate` of height_estimator.h."""

    _fields_ = (
        ("height", _REALS),
        ("variance", _REALS),
        ("unseen", _INTEGERS),
        ("dead_evidence", _REALS),
        ("ink", InkStruct * 2),
        ("evidence", InkEvidenceStruct),
        ("noise_variance", ctypes.c_double),
        ("scans", ctypes.c_int32),
    )


class JettedLayerStruct(ctypes.Structure):
    """`JettedLayer` of droplet_increments.h."""

    _fields_ = (
        ("nx", ctypes.c_size_t),
        ("ny", ctypes.c_size_t),
        ("pattern", _INTEGERS),
        ("factor", _REALS),
        ("passes", ctypes.c_int32),
        ("order", _INTEGERS),
    )


_PROBLEM = ctypes.POINTER(ProblemStruct)
_ESTIMATOR = ctypes.POINTER(EstimatorOptionsStruct)
_ESTIMATE = ctypes.POINTER(EstimateStruct)
_LAYER = ctypes.POINTER(JettedLayerStruct)
_REPORT = ctypes.POINTER(ReportStruct)
_ENTRY_POINTS = {
    "inkloop_core_interface": (ctypes.c_int32, ()),
    "inkloop_layer": (
        ctypes.c_double,
        (*_GRID, _REALS, _INTEGERS, ctypes.POINTER(InkStruct), _REALS, ctypes.c_int32, _INTEGERS, _REALS, _REALS),
    ),
    "inkloop_objective": (ctypes.c_int32, (_PROBLEM, _INTEGERS, ctypes.POINTER(ObjectiveStruct))),
    "inkloop_search": (
        ctypes.c_int32,
        (_PROBLEM, ctypes.POINTER(SearchOptionsStruct), _INTEGERS, _REPORT),
    ),
    "inkloop_paper_search": (
        ctypes.c_int32,
        (_PROBLEM, _INTEGERS, ctypes.c_int64, ctypes.c_int64, ctypes.c_uint64, _REPORT),
    ),
    "inkloop_plan": (
        ctypes.c_int32,
        (_PROBLEM, ctypes.POINTER(PlanWorkStruct), _INTEGERS, ctypes.POINTER(PlanReportStruct)),
    ),
    "inkloop_relax": (
        ctypes.c_int32,
        (_PROBLEM, ctypes.POINTER(RelaxationOptionsStruct), _REALS, ctypes.POINTER(RelaxationReportStruct)),
    ),
    "inkloop_relaxed_gradient": (ctypes.c_int32, (_PROBLEM, _REALS, ctypes.c_double, _REALS, _REALS)),
    "inkloop_diffuse": (ctypes.c_int32, (_PROBLEM, _REALS, _INTEGERS)),
    "inkloop_estimate_first": (None, (_ESTIMATOR, _REALS, _MARKS, _ESTIMATE)),
    **dict.fromkeys(
        ("inkloop_estimate_next", "inkloop_estimate_unknown"),
        (ctypes.c_int32, (_ESTIMATOR, _ESTIMATE, _LAYER, _REALS, _MARKS, _ESTIMATE)),
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
    """Package folders; an editable install leaves the sources where they are and puts built files beside NumPy."""
    package = files(_PACKAGE)
    if isinstance(package, Path):
        yield package
    for scheme in ("platlib", "purelib"):
        yield Path(sysconfig.get_path(scheme)) / _PACKAGE


def _file_name() -> str:
    if sys.platform == "win32":
        return "inkloop_core.dll"
    return "libinkloop_core.dylib" if sys.platform == "darwin" else "libinkloop_core.so"
