"""Bus processes forked from one that has imported their modules: imports take most of the time of a short one.

A test run starts a hundred of them. Commands in processes of their own, killed sessions and tests that change the
environment still start theirs as users do.
"""

from __future__ import annotations

import io
import multiprocessing
import os
import subprocess
import sys
from multiprocessing.connection import Connection
from pathlib import Path
from types import SimpleNamespace
from typing import Any

COMMAND = [sys.executable, "-P", "-m", "inkloop_hardware.bus.process"]
OPTIONS = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "bufsize": 0, "start_new_session": True}
OF_A_TEST = "PYTEST_CURRENT_TEST"
FORKING = multiprocessing.get_context("forkserver")
FORKING.set_forkserver_preload(["inkloop_hardware.bus.process"])


def _own() -> dict[str, str]:
    return {name: value for name, value in os.environ.items() if name != OF_A_TEST}


class ForkedBus:
    """The part of `subprocess.Popen` that `BusConnection` uses."""

    def __init__(self) -> None:
        (commands, stdin), (stdout, answers) = os.pipe(), os.pipe()
        theirs = [Connection(file) for file in (commands, answers, os.dup(2))]
        self._process = FORKING.Process(target=_become, args=(str(Path.cwd()), *theirs), daemon=True)
        self._process.start()
        for file in theirs:
            file.close()
        self.stdin, self.stdout, self.pid = io.FileIO(stdin, "w"), io.FileIO(stdout), self._process.pid

    @property
    def returncode(self) -> int | None:
        """Its exit code, None while it runs."""
        return self._process.exitcode

    def wait(self, timeout: float | None = None) -> int:
        """Its exit code; subprocess.TimeoutExpired."""
        self._process.join(timeout)
        if self.returncode is None:
            raise subprocess.TimeoutExpired(COMMAND, timeout or 0.0)
        return self.returncode

    def kill(self) -> None:
        """Kill it."""
        self._process.kill()


def _become(folder: str, *files: Connection) -> None:
    from inkloop_hardware.bus import process

    os.setsid()
    os.chdir(folder)
    for number, file in enumerate(files):
        os.dup2(file.fileno(), number)
        file.close()
    sys.stdin = os.fdopen(0)  # that of a process of multiprocessing reads nothing
    os._exit(process.main())


def patched() -> SimpleNamespace:
    """The module `subprocess`; in the environment of this call a bus process is forked."""
    unchanged = _own()

    def popen(command: list[str], **options: Any) -> subprocess.Popen[bytes] | ForkedBus:
        if (command, options) == (COMMAND, OPTIONS) and _own() == unchanged:
            return ForkedBus()
        return subprocess.Popen(command, **options)

    return SimpleNamespace(**{**vars(subprocess), "Popen": popen})
