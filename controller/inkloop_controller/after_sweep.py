"""What C asks after each sweep of a search, and what becomes of an exception in the answer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from inkloop_controller.core_structs import AFTER_SWEEP, ReportStruct
from inkloop_controller.horizon_problem import SearchProgress


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
