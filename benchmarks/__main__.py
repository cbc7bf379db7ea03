"""Run all benchmarks, or those named: python -m benchmarks [layer_map master ...] [--seeds N] [--sides N ...]."""

from __future__ import annotations

import argparse
import importlib
import sys

from rich.console import Console

from benchmarks import NAMES, PRINTING, use_one_thread


def main(arguments: list[str]) -> int:
    """Measure and print one table after the other."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"default: {', '.join(NAMES)}")
    parser.add_argument("--seeds", type=int, help="of whole prints (default: 10, lying_scans 3)")
    parser.add_argument("--only", nargs="+", default=(), help="cases of lying_scans, by parts of their names")
    parser.add_argument(
        "--sides",
        type=int,
        nargs="+",
        help="cells a side, of time_limit (default: 100 300 1000) and on_device (1000)",
    )
    options = parser.parse_args(arguments)
    names = options.names
    unknown = sorted(set(names) - set(NAMES))
    if unknown:
        print(f"no benchmark called {', '.join(unknown)}; there are {', '.join(NAMES)}", file=sys.stderr)
        return 1
    use_one_thread()
    console = Console(width=140)
    for name in names or NAMES:
        seeds = {"seeds": options.seeds or PRINTING[name]} if name in PRINTING else {}
        sides = {"sides": tuple(options.sides)} if name in ("time_limit", "on_device") and options.sides else {}
        only = {"only": options.only} if name == "lying_scans" else {}
        console.print(importlib.import_module(f"benchmarks.{name}").measure(**seeds, **sides, **only))
    return 0


sys.exit(main(sys.argv[1:]))
