"""How much work a layer may take."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf


@dataclass(frozen=True)
class Work:
    """Budgets of one layer, in work so that the same bits come out everywhere.

    sweeps: of the repair of one start; annealing_sweeps: of one more start that is annealed first (None: 50 for
    a single layer, up to 200 for a small plan of several, none for a large one), with it every start;
    iterations: of the relaxation; threads: does not change the answer; time_limit: guard by the clock [s].
    Raises ValueError, all faults in one sentence, for budgets that cannot be meant.
    """

    sweeps: int = 30
    annealing_sweeps: int | None = None
    iterations: int = 10
    threads: int = 1
    time_limit: float = inf

    def __post_init__(self) -> None:
        least = {"sweeps": 1, "annealing_sweeps": 0, "iterations": 1, "threads": 1}
        faults = [
            f"{name} is {getattr(self, name)}; needs at least {bound}"
            for name, bound in least.items()
            if (value := getattr(self, name)) is not None and value < bound
        ]
        if not self.time_limit > 0.0:
            faults.append(f"time_limit is {self.time_limit}; needs a time above 0 s")
        if faults:
            raise ValueError("; ".join(faults))


DEFAULT_WORK = Work()
