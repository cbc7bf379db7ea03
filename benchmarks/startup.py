"""Processor time that commands take to start: user and system, over that of `python -c pass`."""

from __future__ import annotations

import resource
import subprocess
import sys
from functools import cache
from pathlib import Path
from statistics import median

from rich.table import Table

ROUNDS = 9
SCENARIO = Path(__file__).parents[1] / "scenarios" / "cylinder.toml"
COMMAND = "import sys; from inkloop.cli import main; sys.exit(main(sys.argv[1:]))"
LIMITS_S = {"--version": 0.25, "--help": 0.25, f"validate {SCENARIO.name}": 0.9}
IMPORTS = ("import inkloop", "import inkloop_controller; inkloop_controller.LayerMpc", "import inkloop; inkloop.run")


def measure() -> Table:
    """Median processor times, and the limits of the commands that have one."""
    table = Table(title=f"processor time to start, over python -c pass, median of {ROUNDS}")
    for heading in ("command", "time", "limit", "kept"):
        table.add_column(heading, justify="left" if heading == "command" else "right")
    for words, limit in LIMITS_S.items():
        taken = over_nothing(words)
        table.add_row(f"inkloop {words}", f"{taken:.2f} s", f"{limit:.2f} s", "yes" if taken <= limit else "NO")
    for code in IMPORTS:
        table.add_row(code, f"{_processor_s(code) - _empty_s():.2f} s", "", "")
    return table


def over_nothing(words: str) -> float:
    """Median processor time of an inkloop command [s], over that of an empty program."""
    arguments = [str(SCENARIO) if word == SCENARIO.name else word for word in words.split()]
    return _processor_s(COMMAND, *arguments) - _empty_s()


@cache
def _empty_s() -> float:
    return _processor_s("pass")


def _processor_s(code: str, *arguments: str) -> float:
    return median(_once(code, *arguments) for _ in range(ROUNDS))


def _once(code: str, *arguments: str) -> float:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", code, *arguments], check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
