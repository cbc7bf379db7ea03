"""How well a time limit holds: plans with more work to do than time for it."""

from __future__ import annotations

from collections import Counter
from time import perf_counter

import numpy as np
from rich.progress import track
from rich.table import Table

from benchmarks.instances import nearly_flat, rough
from benchmarks.planner import planned
from benchmarks.timing import scaled

CASES = 200
SIDES = (60, 100, 200)
LIMITS_S = (0.05, 0.1, 0.3)
WORK = {"sweeps": 500, "iterations": 100, "annealing_sweeps": 200}


def measure() -> Table:
    """Overshoot of the limit over random cases of every size, horizon and alpha."""
    rng = np.random.default_rng(0)
    found: dict[float, list[tuple[float, str]]] = {limit: [] for limit in LIMITS_S}
    for case in track(range(CASES), description="time limit", transient=True):
        side, layers = int(rng.choice(SIDES)), int(rng.integers(1, 4))
        limit, alpha = float(rng.choice(LIMITS_S)), float(rng.choice((0.8, 1.0)))
        flat = nearly_flat(side, layers, alpha=alpha) if case % 2 else rough((side, side), layers, alpha=alpha)
        begin = perf_counter()
        plan = planned(flat, time_limit=limit, **WORK)
        found[limit].append((perf_counter() - begin, str(plan.status)))
    table = Table(title=f"time limit of a plan, {CASES} cases of {min(SIDES)} to {max(SIDES)} cells a side, N = 1 to 3")
    for heading in ("limit", "cases", "median", "worst", "above by", "more than 5 % above", "how they ended"):
        table.add_column(heading, justify="right")
    for limit, cases in found.items():
        times = np.array([time for time, _ in cases])
        ended = ", ".join(f"{status} {count}" for status, count in Counter(status for _, status in cases).items())
        above = f"{max(0.0, times.max() / limit - 1.0):.1%}"
        late = str(np.count_nonzero(times > 1.05 * limit))
        table.add_row(
            scaled(limit), str(len(cases)), scaled(float(np.median(times))), scaled(times.max()), above, late, ended
        )
    return table
