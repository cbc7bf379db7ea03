"""One layer decision from small to large grids: seconds, microseconds and bytes per cell, one thread and two."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from pathlib import Path
from time import perf_counter

from rich.table import Table

from benchmarks.instances import nearly_flat
from benchmarks.timing import scaled
from inkloop_controller import core
from inkloop_controller.droplet_relaxation import diffuse, relax

CASES = (*((side, layers) for layers in (1, 2, 3) for side in (20, 100, 500)), (2048, 1))
THREADS = (1, 2)
KIBIBYTE = 1024  # unit of ru_maxrss on Linux


def measure() -> Table:
    """Each case in a process of its own, so that its peak of memory is its own."""
    table = Table(title="one layer decision on nearly flat printed surfaces: relaxation, rounding, search")
    for heading in ("grid", "layers", "threads", "objective [um]", "time", "us per cell", "bytes per cell"):
        table.add_column(heading, justify="right")
    for side, layers in CASES:
        for threads in THREADS:
            found = _in_a_process(side, layers, threads)
            table.add_row(
                f"{side} x {side}", str(layers), str(threads), f"{found['objective_m'] * 1e6:.4f}",
                scaled(found["time_s"]), f"{found['time_s'] * 1e6 / side**2:.2f}", f"{found['memory'] / side**2:.0f}",
            )  # fmt: skip
    return table


def _in_a_process(side: int, layers: int, threads: int) -> dict[str, float]:
    command = [sys.executable, "-m", "benchmarks.scaling", str(side), str(layers), str(threads)]
    run = subprocess.run(command, check=True, capture_output=True, text=True, cwd=Path(__file__).parents[1])
    found: dict[str, float] = json.loads(run.stdout)
    return found


def _decide(side: int, layers: int, threads: int) -> dict[str, float]:
    """Time and objective of the decision, and by how much the peak of memory [byte] grew over it.

    On small grids that is what NumPy and the C library keep in any case, not what the cells take.
    """
    problem = nearly_flat(side, layers)
    before, begin = _peak(), perf_counter()
    start = diffuse(problem, relax(problem).droplets)
    found = core.search(problem, start, sweeps_max=50, threads=threads)
    time_s = perf_counter() - begin
    return {"objective_m": found.objective.value, "time_s": time_s, "memory": _peak() - before}


def _peak() -> float:
    return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * KIBIBYTE)


if __name__ == "__main__":
    print(json.dumps(_decide(*map(int, sys.argv[1:]))))
