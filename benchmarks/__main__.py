"""Run all benchmarks, or those named: python -m benchmarks [layer_step master ...]; `NAMES` has them all."""

from __future__ import annotations

import importlib
import os
import sys

from rich.console import Console

NAMES = (
    "layer_step",
    "deposition_models",
    "young_laplace",
    "remeshing",
    "startup",
    "master",
    "scaling",
    "time_limit",
    "controller_step",
    "peers",
    "targets",
)

ALONE = ("hardware", "bench_faults")
"""Run only when named: they want the machine for themselves."""


def main(names: list[str]) -> int:
    """Measure and print one table after the other."""
    unknown = sorted(set(names) - {*NAMES, *ALONE})
    if unknown:
        print(f"no benchmark called {', '.join(unknown)}; there are {', '.join((*NAMES, *ALONE))}", file=sys.stderr)
        return 1
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # threads that wait for each other would count as processor time
    console = Console(width=140)
    for name in names or NAMES:
        console.print(importlib.import_module(f"benchmarks.{name}").measure())
    return 0


sys.exit(main(sys.argv[1:]))
