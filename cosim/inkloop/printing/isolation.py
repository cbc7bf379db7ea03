"""Print in a subprocess, so that a crash of native code, such as an FMU's, becomes an error message."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from inkloop.errors import ComponentError
from inkloop.files import temporary_folder
from inkloop.master.interrupt import deferred
from inkloop.results import checkpoint
from inkloop.results.result import RUN_FILE, read_record

_COMMAND = "import sys; from inkloop.cli import main; sys.exit(main(sys.argv[1:]))"
_EXIT_CODES = (0, 1, 2, 4, 130)  # of the inkloop command; 2 is argparse's


def run_isolated(arguments: Sequence[str], folder: Path, foreign: Sequence[str] = ()) -> int:
    """`inkloop ARGUMENTS`, which prints into `folder`, in a child; its exit code. Ctrl-C is the child's.

    foreign: the components that are an FMU of others. Temporary files of the child are removed in any case. Raises
    ComponentError if it crashed: cause, kept layers and how to resume.
    """
    with temporary_folder("run") as unpacked, deferred():
        environment = {**os.environ, "TMPDIR": str(unpacked)}
        code = subprocess.call([sys.executable, "-c", _COMMAND, *arguments], env=environment)
    if code == -signal.SIGINT:
        return 130
    if code in _EXIT_CODES and not (code == 0 and _running(folder)):
        return code
    suspect = f"most likely of {' or '.join(foreign)}" if foreign else "of a component or a library"
    raise ComponentError(
        f"the print was ended by {_ending(code)}: native code crashed, {suspect}; {_advice(folder)}\n"
        "to see the place, run it with --no-isolate under python -X faulthandler"
    )


def _running(folder: Path) -> list[Path]:
    """Prints in a folder that are recorded as running: if no process runs, native code has ended them."""
    folders = sorted(path.parent for path in folder.rglob(RUN_FILE))
    return [place for place in folders if read_record(place).get("stop_reason") == "running"]


def _ending(code: int) -> str:
    """The name of a signal, or an exit code that inkloop does not use."""
    known = {-entry.value: entry.name for entry in signal.Signals}
    return known.get(code, f"signal {-code}" if code < 0 else f"exit code {code:#x}")


def _advice(folder: Path) -> str:
    """The layers on disk and how to resume."""
    if not (folder / RUN_FILE).is_file():
        return "nothing was printed yet; fix the cause, then run it again"
    place = next(iter(_running(folder)), folder)
    last = checkpoint.last(place)
    if last is None:
        return f"no layer was finished; fix the cause, then continue with `inkloop resume {folder}`"
    kept = f"layers 0 to {last.layer} are in {place}"
    if last.refusal:
        return f"{kept}; the run cannot be resumed: {last.refusal}"
    return f"{kept}; fix the cause, then continue with `inkloop resume {folder}`"
