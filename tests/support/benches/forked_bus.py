"""Bus processes forked from one that has imported their modules: imports take most of the time of a short one.

A test run starts a hundred of them. Commands in processes of their own, killed sessions and tests that change the
environment still start theirs as users do.
"""

from __future__ import annotations

import gc
import io
import json
import os
import select
import signal
import socket
import subprocess
import sys
import traceback
from functools import cache
from pathlib import Path
from struct import Struct
from types import SimpleNamespace
from typing import Any

COMMAND = [sys.executable, "-P", "-m", "inkloop_hardware.bus.process"]
OPTIONS = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "bufsize": 0, "start_new_session": True}
NUMBER = Struct("i")
"""A process id, or what `os.wait` says of its end."""
FILES = 4
"""stdin, stdout, stderr, and where a process id and an end are written."""
OF_A_TEST = "PYTEST_CURRENT_TEST"


def _environment() -> dict[str, str]:
    return {name: value for name, value in os.environ.items() if name != OF_A_TEST}


class Source:
    """The process that bus processes are forked from."""

    def __init__(self) -> None:
        self.environment = _environment()
        self._requests, theirs = socket.socketpair()
        with theirs:
            words = [sys.executable, "-P", __file__, str(theirs.fileno())]
            self._process = subprocess.Popen(
                words, stdin=subprocess.DEVNULL, pass_fds=[theirs.fileno()], start_new_session=True
            )

    def fork(self, files: list[int]) -> None:
        """A bus process with these FILES."""
        socket.send_fds(self._requests, [json.dumps(str(Path.cwd())).encode()], files)

    def close(self) -> None:
        """End it, when all of its bus processes have ended."""
        self._requests.close()
        self._process.wait()


class ForkedBus:
    """The part of `subprocess.Popen` that `BusConnection` uses."""

    def __init__(self, source: Source) -> None:
        (commands, stdin), (stdout, answers), (end, report) = os.pipe(), os.pipe(), os.pipe()
        source.fork([commands, answers, 2, report])
        for file in (commands, answers, report):
            os.close(file)
        self.stdin, self.stdout, self._end = io.FileIO(stdin, "w"), io.FileIO(stdout), io.FileIO(end)
        self.pid: int = NUMBER.unpack(self._end.read(NUMBER.size))[0]
        self.returncode: int | None = None

    def wait(self, timeout: float | None = None) -> int:
        """Its exit code; subprocess.TimeoutExpired."""
        if self.returncode is None:
            if not select.select([self._end], [], [], timeout)[0]:
                raise subprocess.TimeoutExpired(COMMAND, timeout or 0.0)
            self.returncode = os.waitstatus_to_exitcode(NUMBER.unpack(self._end.read(NUMBER.size))[0])
            self._end.close()
        return self.returncode

    def kill(self) -> None:
        """Kill it."""
        if self.returncode is None:
            os.kill(self.pid, signal.SIGKILL)


@cache
def source() -> Source:
    """That of this process."""
    return Source()


def popen(command: list[str], **options: Any) -> subprocess.Popen[bytes] | ForkedBus:
    """A forked bus process for the command of one in an environment that the test did not change."""
    if (command, options) == (COMMAND, OPTIONS) and _environment() == source().environment:
        return ForkedBus(source())
    return subprocess.Popen(command, **options)


def patched() -> SimpleNamespace:
    """The module `subprocess` with `popen`."""
    return SimpleNamespace(**{**vars(subprocess), "Popen": popen})


def serve(requests: socket.socket) -> None:
    """Fork a bus process at each request until the requests end."""
    from inkloop_hardware.bus import process
    from inkloop_hardware.protocol.codec import Codec

    Codec()  # keeps the DBC
    gc.freeze()
    children = set[int]()
    while True:
        content, files, _, _ = socket.recv_fds(requests, 1 << 16, FILES)
        if not content:
            break
        child = os.fork()
        if child == 0:
            requests.close()
            _report(process.main, json.loads(content), *files)
        children.add(child)
        for file in files:
            os.close(file)
        children -= {child for child in children if os.waitpid(child, os.WNOHANG) != (0, 0)}
    for child in children:
        os.waitpid(child, 0)


def _report(main: Any, folder: str, commands: int, answers: int, errors: int, report: int) -> None:
    """Fork it once more, and say how it ends: only a parent learns that."""
    child = os.fork()
    if child == 0:
        os.close(report)
        _become(main, folder, commands, answers, errors)
    for file in (commands, answers, errors):
        os.close(file)
    os.write(report, NUMBER.pack(child))
    os.write(report, NUMBER.pack(os.waitpid(child, 0)[1]))
    os._exit(0)


def _become(main: Any, folder: str, *files: int) -> None:
    status = 1
    try:
        os.setsid()
        os.chdir(folder)
        for number, file in enumerate(files):
            os.dup2(file, number)
            os.close(file)
        status = main()
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(status)


if __name__ == "__main__":
    serve(socket.socket(fileno=int(sys.argv[1])))
