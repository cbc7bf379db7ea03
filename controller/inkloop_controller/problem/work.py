"""How much work a layer may take."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import inf
from time import perf_counter
from typing import Annotated

from inkloop_controller.problem.options import Option, Positive

ANNEALING_SWEEPS = Option(
    meaning="of simulated annealing before one more repair: 50 for a single layer, up to 200 for a small plan of "
    "several, none for large ones",
    absent="by size",
)
THREADS = Option(meaning="of the plan and of the estimate after a scan; both are the same for any number")
TIME_LIMIT = Option(
    unit="s",
    meaning="limit on the clock from the scan to the pattern; the best plan so far is printed. If it takes effect, a "
    "run is no longer the same on every machine",
    form=Positive,
)


@dataclass(frozen=True)
class Work:
    """Budgets of one layer, in work so that the same bits come out everywhere.

    sweeps: of the repair of one start; annealing_sweeps: of one more start that is annealed first (None: 50 for
    a single layer, up to 200 for a small plan of several, none for a large one), with it every start;
    iterations: of the relaxation; threads: does not change the answer; time_limit: guard by the clock [s],
    from the scan on.
    Raises ValueError, all errors in one sentence, for invalid budgets.
    """

    sweeps: Annotated[int, Option()] = 30
    annealing_sweeps: Annotated[int | None, ANNEALING_SWEEPS] = None
    iterations: Annotated[int, Option()] = 10
    threads: Annotated[int, THREADS] = 1
    time_limit: Annotated[float, TIME_LIMIT] = inf

    def __post_init__(self) -> None:
        least = {"sweeps": 1, "annealing_sweeps": 0, "iterations": 1, "threads": 1}
        errors = [
            f"{name} is {getattr(self, name)}; needs at least {bound}"
            for name, bound in least.items()
            if (value := getattr(self, name)) is not None and value < bound
        ]
        if not self.time_limit > 0.0:
            errors.append(f"time_limit is {self.time_limit}; needs a time above 0 s")
        if errors:
            raise ValueError("; ".join(errors))


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
        """What runs inside counts for the phase `name`."""
        begin = perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + perf_counter() - begin
