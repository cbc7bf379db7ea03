"""One layer decision from small to large grids: time and memory per cell, one thread and two."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from hashlib import sha256
from pathlib import Path
from time import perf_counter
from typing import Any

from rich.progress import track
from rich.table import Table

from benchmarks.instances import nearly_flat
from benchmarks.planner import planned
from benchmarks.timing import scaled
from inkloop.units import UM_PER_M

SIDE_MAX = {1: 2048, 2: 1000, 3: 500}
"""By layers of the horizon: the next larger grid takes more than half a minute (by trial) and is left out."""
CASES = tuple(
    (side, layers) for layers in SIDE_MAX for side in (20, 50, 100, 200, 500, 1000, 2048) if side <= SIDE_MAX[layers]
)
SIDE_OF_MEMORY = 200  # below, what the libraries keep for themselves hides what the cells take (by trial)
KIBIBYTE = 1024  # unit of ru_maxrss on Linux


def measure() -> Table:
    """Wall time and peak of memory of `LayerMpc` with its default work, each decision in a process of its own."""
    table = Table(title="one layer decision on nearly flat printed surfaces, alpha 1; bytes in addition to the problem")
    for heading in (
        "grid",
        "layers",
        "objective, um",
        "time",
        "per cell",
        "bytes per cell",
        "two threads",
        "gain",
        "bits",
    ):
        table.add_column(heading, justify="right")
    for side, layers in track(CASES, "scaling", transient=True):
        one, two = (_in_a_process(side, layers, threads) for threads in (1, 2))
        table.add_row(
            f"{side} x {side}",
            str(layers),
            f"{one['objective_m'] * UM_PER_M:.4f}",
            scaled(one["time_s"]),
            scaled(one["time_s"] / side**2),
            f"{one['memory'] / side**2:.0f}" if side >= SIDE_OF_MEMORY else "-",
            scaled(two["time_s"]),
            f"{one['time_s'] / two['time_s']:.2f}",
            "the same" if one["plan"] == two["plan"] else "DIFFERENT",
        )
    return table


def _in_a_process(side: int, layers: int, threads: int) -> dict[str, Any]:
    command = [sys.executable, "-m", "benchmarks.scaling", str(side), str(layers), str(threads)]
    run = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[1])
    found: dict[str, Any] = json.loads(run.stdout)
    return found


def _decide(side: int, layers: int, threads: int) -> dict[str, Any]:
    """Time [s] and objective [m] of the decision, how far memory rose over what was held before [byte], its plan."""
    problem = nearly_flat(side, layers)
    held, begin = _held(), perf_counter()
    plan = planned(problem, threads)
    time_s = perf_counter() - begin
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * KIBIBYTE - held
    plan_hash = sha256(plan.plan.tobytes()).hexdigest()
    return {"objective_m": plan.objective.value, "time_s": time_s, "memory": memory, "plan": plan_hash}


def _held() -> int:
    """Memory of this process now [byte], Linux."""
    resident = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
    return int(resident) * os.sysconf("SC_PAGE_SIZE")


if __name__ == "__main__":
    print(json.dumps(_decide(*map(int, sys.argv[1:]))))
