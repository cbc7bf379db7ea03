"""Print in a subprocess, so that a crash of native code, such as an FMU's, becomes an error message."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from inkloop.errors import ComponentError
from inkloop.files import temporary_folder
from inkloop.master.interrupt import advised, deferred
from inkloop.printing.advice import advice_on, unfinished

_COMMAND = "import sys; from inkloop.cli import main; sys.exit(main(sys.argv[1:]))"
_EXIT_CODES = (0, 1, 2, 4, 130)  # of the inkloop command; 2 is argparse's


def run_isolated(arguments: Sequence[str], folder: Path, foreign: Sequence[str] = ()) -> int:
    """`inkloop ARGUMENTS`, which prints into `folder`, in a child; its exit code. Ctrl-C is the child's.

    foreign: the components that are an FMU of others. Temporary files of the child are removed in any case. Raises
    ComponentError if it crashed: cause, kept layers and how to resume.
    """
    with temporary_folder("run") as unpacked, deferred(), advised(partial(advice_on, folder)):
        environment = {**os.environ, "TMPDIR": str(unpacked)}
        code = subprocess.call([sys.executable, "-c", _COMMAND, *arguments], env=environment)
    if code == -signal.SIGINT:
        return 130
    is_left = code == 0 and "running" in unfinished(folder).values()  # by native code, which has ended the process
    if code in _EXIT_CODES and not is_left:
        return code
    suspect = f"most likely of {' or '.join(foreign)}" if foreign else "of a component or a library"
    advice = advice_on(folder, "fix the cause, then ")
    raise ComponentError(
        f"the print was ended by {_ending(code)}: native code crashed, {suspect}; {advice}\n"
        "to see the place, run it with --no-isolate under python -X faulthandler"
    )


def _ending(code: int) -> str:
    """The name of a signal, or an exit code that inkloop does not use."""
    known = {-entry.value: entry.name for entry in signal.Signals}
    return known.get(code, f"signal {-code}" if code < 0 else f"exit code {code:#x}")
