"""A command in a process of its own, so that a crash of native code, an FMU's say, still ends in words."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Sequence

from inkloop.errors import ComponentError
from inkloop.interrupt import deferred

_COMMAND = "import sys; from inkloop.cli import main; sys.exit(main(sys.argv[1:]))"


def run_isolated(arguments: Sequence[str]) -> int:
    """`inkloop ARGUMENTS` in a child; its exit code. Ctrl-C is the child's. Raises ComponentError if it crashed."""
    with deferred():
        code = subprocess.call([sys.executable, "-c", _COMMAND, *arguments])
    if code < 0 and -code != signal.SIGINT:
        raise ComponentError(
            f"the process was ended by {_name(-code)}: native code of a component, an FMU or a library, crashed; files "
            "written by then are whole; to see the place, run without --isolate under python -X faulthandler"
        )
    return code if code >= 0 else 130


def _name(number: int) -> str:
    """The name of a signal."""
    known = {entry.value: entry.name for entry in signal.Signals}
    return known.get(number, f"signal {number}")
