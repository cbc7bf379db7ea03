"""Limits of the work on a layer."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import inf
from time import perf_counter
from typing import Annotated

from inkloop_controller.problem.options import declared, default, errors_of, refuse
from inkloop_controller.problem.variables import options


@dataclass(frozen=True)
class Work:
    """Budgets of one layer, in work so that the same bits come out everywhere.

    sweeps: of the repair of one start; annealing_sweeps: of one more start that is annealed first (None: 50 for
    a single layer, up to 200 for a small plan of several, none for a large one), with it every start;
    iterations: of the relaxation; threads: does not change the answer; time_limit: guard by the clock [s],
    from the scan on.
    Raises ValueError, all errors in one sentence, for invalid budgets.
    """

    sweeps: Annotated[int, declared("sweeps_max")] = default("sweeps_max")
    annealing_sweeps: Annotated[int | None, declared("annealing_sweeps")] = default("annealing_sweeps")
    iterations: Annotated[int, declared("iterations")] = default("iterations")
    threads: Annotated[int, declared("threads")] = default("threads")
    time_limit: Annotated[float, declared("time_limit")] = default("time_limit")

    def __post_init__(self) -> None:
        given = {name: value for name, value in vars(self).items() if name != "sweeps"}
        refuse(options()["sweeps_max"].errors(self.sweeps, "sweeps") + errors_of(**given))


DEFAULT_WORK = Work()


class Stopwatch:
    """Runs from its making; limit [s]."""

    def __init__(self, limit: float = inf) -> None:
        self._end = perf_counter() + limit
        self.seconds: dict[str, float] = {}

    @property
    def remaining(self) -> float:
        """Remaining time [s], at least 0."""
        return max(0.0, self._end - perf_counter())

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Count the time of the block for the phase `name`."""
        begin = perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + perf_counter() - begin
