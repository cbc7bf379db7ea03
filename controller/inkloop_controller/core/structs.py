"""ctypes structs of the C search core, as in the headers in controller/core."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

from inkloop_controller.problem.horizon_problem import HORIZON_MAX, KINDS_MAX, SearchProgress

REALS = ctypes.POINTER(ctypes.c_double)
INTEGERS = ctypes.POINTER(ctypes.c_int32)
MARKS = ctypes.POINTER(ctypes.c_uint8)
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
        ("height", REALS),
        ("target", REALS),
        ("ceiling", REALS),
        ("part", MARKS),
        ("weight", REALS),
        ("choices", _CHOICES),
        ("kinds", ctypes.c_size_t),
        ("kind", InkStruct * KINDS_MAX),
        ("alpha", ctypes.c_double),
        ("overshoot", ctypes.c_double),
        ("ceiling_cost", ctypes.c_double),
        ("droplet_std", ctypes.c_double),
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
    """`PlanWork` of plan_work.h."""

    _fields_ = (
        ("relaxation", ctypes.c_int32),
        ("relaxed", REALS),
        ("last", INTEGERS),
        ("last_layers", ctypes.c_size_t),
        ("layer_worth", ctypes.c_double),
        ("longer", INTEGERS),
        ("longer_value", ctypes.c_double),
        ("layer_price", ctypes.c_double),
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
        ("left_out", ctypes.c_int32),
        ("sweeps", ctypes.c_int64),
        ("objective", ObjectiveStruct),
        ("nothing", ObjectiveStruct),
        ("evaluation", ctypes.c_double),
        ("seconds", ctypes.c_double * 3),
    )


class PlanFiguresStruct(ctypes.Structure):
    """`PlanFigures` of step_state.h."""

    _fields_ = (
        ("status", ctypes.c_int32),
        ("left_out", ctypes.c_int32),
        ("sweeps", ctypes.c_int64),
        ("objective", ObjectiveStruct),
        ("bound", ctypes.c_double),
        ("bound_confidence", ctypes.c_double),
        ("seconds", ctypes.c_double),
    )


class LayerStepStruct(ctypes.Structure):
    """`LayerStep` of step_options.h."""

    _fields_ = (
        ("values", ctypes.c_void_p),
        ("region_offsets", ctypes.POINTER(ctypes.c_int64)),
        ("region_bottoms", REALS),
        ("region_tops", REALS),
        ("threads", ctypes.c_int32),
        ("take_as_read", ctypes.c_int32),
    )


class ProblemMapsStruct(ctypes.Structure):
    """`ProblemMaps` of step_problem.h."""

    _fields_ = (("ceiling", REALS), ("weight", REALS), ("choices", _CHOICES))


class FinishStruct(ctypes.Structure):
    """`Finish` of shortest_plan.h."""

    _fields_ = (("horizon", ctypes.c_int32), ("foreign_horizon", ctypes.c_int32), ("layer_worth", ctypes.c_double))


class RelaxationOptionsStruct(ctypes.Structure):
    """`RelaxationOptions` of horizon_problem.h."""

    _fields_ = (("iterations_max", ctypes.c_int64), ("seconds_max", ctypes.c_double), ("threads", ctypes.c_int32))


class RelaxationReportStruct(ctypes.Structure):
    """`RelaxationReport` of horizon_problem.h."""

    _fields_ = (("value", ctypes.c_double), ("iterations", ctypes.c_int64))


class SurfaceToPlanStruct(ctypes.Structure):
    """`SurfaceToPlan` of step_problem.h."""

    _fields_ = (
        ("height", REALS),
        ("variance", REALS),
        ("dead", MARKS),
        ("capped", MARKS),
        ("figures", ctypes.c_void_p),
    )


class AfterSweep:
    """`wanted` sees each sweep, True stops the search; so does an exception, which must not pass through C.

    It is needed without `wanted` too: Python sees Ctrl-C only while it runs.
    """

    def __init__(self, wanted: Callable[[SearchProgress], bool] | None = None) -> None:
        self._wanted = wanted
        self._raised: BaseException | None = None
        self.callback = AFTER_SWEEP(self._ask)

    def was_interrupted(self) -> bool:
        """Whether Ctrl-C has stopped the search; any other exception is raised now."""
        if self._raised is None or isinstance(self._raised, KeyboardInterrupt):
            return self._raised is not None
        raise self._raised

    def _ask(self, _: int | None, so_far: Any) -> int:
        try:
            return int(self._wanted is not None and bool(self._wanted(progress(so_far.contents))))
        except BaseException as error:
            self._raised = error
            return 1


def progress(report: ReportStruct) -> SearchProgress:
    """How far a search is, from C."""
    counts = (report.sweeps, report.evaluations, report.flips, report.swaps, report.shifts)
    return SearchProgress(report.objective.value, *counts)
