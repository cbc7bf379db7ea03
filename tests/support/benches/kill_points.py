"""Unannounced ends: kill -9 of nodes, master or both, at places that are counted or at a moment from outside.

A session prints until it is done, ends with an error or is killed. The nodes are the installed program, which looks, by
`tests/c/kill_points.c`, before and after each frame of a request or an answer and in the middle of each write; the
master looks in the same way at its messages, journal and checkpoints. At a given look a process kills itself.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from inkloop.bench.commands import emulation_of
from inkloop.cli import main
from inkloop.errors import InkloopError
from inkloop.printing.run import print_part, scenario_of_run
from inkloop.results import array_file
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop_hardware.devices.master_journal import MasterJournal
from inkloop_hardware.emulated_bench import program
from inkloop_hardware.link.rig import NodeWire
from inkloop_hardware.protocol.records import Node
from support import compiled
from support.benches.bench_run import FAST, PATIENCE_S
from support.places import C_SOURCES

BUSY = b"\x03\x7f\x31\x78"
WORDS_FILE, DONE = "words.txt", "done"
POLL_S = 0.002


def looks() -> Path:
    """The library that makes a program look."""
    made = compiled.object_of(C_SOURCES / "kill_points.c", ("-std=c11", "-O1", "-fPIC"))
    return compiled.linked("kill_points.so", [made], ("-shared", "-ldl"))


class Nodes:
    """The nodes of a bench whose power comes back at once: killed at each of `kill_at` looks in turn, then no more.

    looks: the library for `kill_at`."""

    def __init__(self, folder: Path, looks: Path, parameters: dict[str, float], kill_at: Sequence[str] = ()) -> None:
        self.folder, self._looks = folder, looks
        self._options = [f"{name}={value:.17g}" for name, value in parameters.items()]
        self._kill_at, self.killed, self._over = list(kill_at), 0, False
        folder.mkdir()
        self._running, self.channel = self._started(0)
        self._watch = threading.Thread(target=self._restart, daemon=True)
        self._watch.start()

    @property
    def process_id(self) -> int:
        return self._running.pid

    def end(self) -> str:
        """Counts printed by its last process at its end: looks, and those at records of a journal."""
        self._over = True
        self._running.terminate()
        self._watch.join()
        assert self._running.stderr
        return self._running.stderr.read()

    def _started(self, port: int) -> tuple[subprocess.Popen[str], str]:
        at = self._kill_at.pop(0) if self._kill_at else "0"
        preloaded = {"LD_PRELOAD": str(self._looks), "INKLOOP_KILL_AT": at}
        words = ["--until-stdin-closes", "--folder", str(self.folder), "--port", str(port), *self._options]
        pipes: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        running = subprocess.Popen([program(), *words], env=os.environ | preloaded, text=True, **pipes)
        assert running.stdout
        return running, running.stdout.readline().strip()

    def _restart(self) -> None:
        while not self._over:
            if self._running.wait() == -signal.SIGKILL:
                self.killed += 1
                for stream in (self._running.stdin, self._running.stdout, self._running.stderr):
                    assert stream
                    stream.close()
                port = int(self.channel.rpartition(":")[2])
                self._running = self._started(port)[0]


@contextmanager
def powered(path: Path, folder: Path, looks: Path, kill_at: Sequence[str] = (), **times: float) -> Iterator[Nodes]:
    """The nodes of a scenario. They begin to count when they have printed their channel."""
    emulation = emulation_of(Scenario.load(path))
    nodes = Nodes(folder, looks, emulation.parameters | FAST | times, kill_at)
    try:
        yield nodes
    finally:
        nodes.end()


def begin(path: Path, folder: Path, channel: str) -> None:
    """A run folder as `inkloop run` begins it."""
    scenario = Scenario.load(path, {"bench.channel": channel})
    Result.begin(folder, scenario.text, {"scenario_file": str(path.resolve()), "compare": False})


def session(folder: Path) -> Result | InkloopError:
    """Print on, from wherever the folder is."""
    try:
        with scenario_of_run(folder) as scenario:
            return print_part(scenario, folder=folder, notes={"scenario_file": scenario.source, "compare": False})
    except InkloopError as error:
        return error


def clear(folder: Path) -> None:
    """A person has looked at the bench."""
    tries = (main(["bench", "clear", str(folder)]) for _ in range(3))
    assert 0 in tries


class _Looks:
    """Counts; at a given look, of all ("120"), at the journal ("j12") or in a step ("s3"), the process is killed, and
    others with it.
    """

    def __init__(self, kill_at: str, others: Sequence[int]) -> None:
        self.counts, self._kill_at, self._others = {"": 0, "j": 0, "s": 0}, kill_at, others

    def __call__(self, *places: str) -> None:
        for place in ("", *places):
            self.counts[place] += 1
        if self._kill_at in [f"{place}{self.counts[place]}" for place in ("", *places)]:
            for process in (*self._others, os.getpid()):
                os.kill(process, signal.SIGKILL)

    def around(self, call: Callable[..., Any]) -> Callable[..., Any]:
        def watched(*arguments: Any, **options: Any) -> Any:
            self()
            found = call(*arguments, **options)
            self()
            return found

        return watched


def _watch_master(look: _Looks) -> None:
    """Look around messages, renamings and syncs, and in the middle of a line of the journal and of a checkpoint."""
    write_arrays, write, receive = array_file.write_arrays, MasterJournal._write, NodeWire.receive

    def arrays_by_halves(file: Any, arrays: Any) -> None:
        arrays = list(arrays)
        write_arrays(file, arrays[: len(arrays) // 2])
        file.flush()
        look()
        file.seek(0)
        file.truncate()
        write_arrays(file, arrays)

    def write_by_halves(journal: MasterJournal, path: Path, line: bytes) -> None:
        look("j")
        whole = path.stat().st_size if path.exists() else 0
        with path.open("ab") as file:
            file.write(line[: len(line) // 2])
        look("j")
        os.truncate(path, whole)
        write(journal, path, line)
        look("j")

    def receive_and_look(wire: NodeWire, wait_s: float) -> bytes | None:
        found = receive(wire, wait_s)
        if found is not None:
            is_step = found[:4] == BUSY and wire._node in (Node.HEAD, Node.CURE)
            look(*["s"] * is_step)
        return found

    array_file.write_arrays = arrays_by_halves
    MasterJournal._write = write_by_halves  # type: ignore[assignment]
    NodeWire.receive = receive_and_look  # type: ignore[assignment]
    NodeWire.send = look.around(NodeWire.send)
    Path.replace = look.around(Path.replace)


def _master(folder: Path, kill_at: str, others: Sequence[int]) -> None:
    look = _Looks(kill_at, others)
    _watch_master(look)
    _keep_words(folder, session(folder), f": {look.counts}")


def _keep_words(folder: Path, found: Result | InkloopError, counts: str = "") -> None:
    (folder / WORDS_FILE).write_text(str(found) if isinstance(found, InkloopError) else f"{DONE}{counts}")


FORKING = multiprocessing.get_context("forkserver")
FORKING.set_forkserver_preload(
    [
        "inkloop.cli",
        "inkloop.bench.commands",
        "inkloop_controller.controllers",
        "inkloop_hardware.devices.printer",
        "h5py",
        "xarray",
    ]
)  # what takes long to import is there when a session is forked


def session_killed_at(folder: Path, kill_at: str, others: Sequence[int] = ()) -> str | None:
    """A session in a separate process, and `others` killed with it: None if it was, else its last message."""
    process = FORKING.Process(target=_master, args=(folder, kill_at, others))
    process.start()
    process.join(120)
    return _last_words(process, folder)


def session_killed_when(folder: Path, due: Callable[[], bool]) -> str | None:
    """A session in a separate process, killed from outside when it is `due`: None if it was, else its last message."""
    process = FORKING.Process(target=_unwatched_master, args=(folder,))
    process.start()
    until = time.monotonic() + PATIENCE_S
    while process.is_alive() and not due():
        assert time.monotonic() < until, "the session does not go on"
        time.sleep(POLL_S)
    process.kill()
    process.join()
    return _last_words(process, folder)


def _unwatched_master(folder: Path) -> None:
    _keep_words(folder, session(folder))


def _last_words(process: BaseProcess, folder: Path) -> str | None:
    if process.exitcode == -signal.SIGKILL:
        return None
    assert process.exitcode == 0, process.exitcode
    return (folder / WORDS_FILE).read_text()
