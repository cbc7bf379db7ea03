"""How much work a layer may take."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

ONE_LAYER_ANNEALING = 50  # sweeps (by trial)


@dataclass(frozen=True)
class Work:
    """Budgets of one layer, in work so that the same bits come out everywhere.

    sweeps: of the repair of one start; annealing_sweeps: of one more start that is annealed first (None: 50 for a
    horizon of one layer, where they reach proven optima, and none beyond, where they gain little for their time);
    iterations: of the relaxation; threads: does not change the answer; time_limit: guard by the clock [s].
    Raises ValueError, all faults in one sentence, for budgets that cannot be meant.
    """

    sweeps: int = 50
    annealing_sweeps: int | None = None
    iterations: int = 30
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

    def annealing_of(self, layers: int) -> int:
        """Annealing sweeps for a horizon of that many layers."""
        if self.annealing_sweeps is None:
            return ONE_LAYER_ANNEALING if layers == 1 else 0
        return self.annealing_sweeps


DEFAULT_WORK = Work()
