"""Unannounced ends: kill -9 of nodes, master or both at places that are counted, not timed, and what is left.

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
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from inkloop.bench.emulation import emulation_of
from inkloop.cli import main
from inkloop.contract import pass_colours
from inkloop.errors import InkloopError
from inkloop.printing.run import print_part, scenario_of_run
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop_controller.model.layer_model import LayerModel
from inkloop_hardware.devices.master_journal import Asked, Event, MasterJournal, MasterRecord
from inkloop_hardware.emulated_bench import program
from inkloop_hardware.link.node_wire import NodeWire
from inkloop_hardware.protocol.node_state import Happening, JournalRecord, Step
from inkloop_hardware.protocol.vocabulary import Node
from support import compiled
from support.benches.bench_run import FAST
from support.places import C_SOURCES

SECTOR_BYTES, RECORD_BYTES = 4096, 40
BUSY = b"\x03\x7f\x31\x78"
WORDS_FILE, DONE = "words.txt", "done"
RESOLUTION = 1e-7


def looks() -> Path:
    """The library that makes a program look."""
    made = compiled.object_of(C_SOURCES / "kill_points.c", ("-std=c11", "-O1", "-fPIC"))
    return compiled.linked("kill_points.so", [made], ("-shared", "-ldl"))


class Nodes:
    """The nodes of a bench whose power comes back at once: killed at each of `kill_at` looks in turn, then no more."""

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
        """What its last process printed at its end: looks, and those at records of a journal."""
        self._over = True
        self._running.terminate()
        self._watch.join()
        assert self._running.stderr
        return self._running.stderr.read()

    def _started(self, port: int) -> tuple[subprocess.Popen[str], str]:
        at = self._kill_at.pop(0) if self._kill_at else "0"
        environment = os.environ | {"LD_PRELOAD": str(self._looks), "INKLOOP_KILL_AT": at}
        words = ["--until-stdin-closes", "--folder", str(self.folder), "--port", str(port), *self._options]
        pipes: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        running = subprocess.Popen([program(), *words], env=environment, text=True, **pipes)
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
        scenario = scenario_of_run(folder)
        return print_part(scenario, folder=folder, notes={"scenario_file": scenario.source, "compare": False})
    except InkloopError as error:
        return error


def clear(folder: Path) -> None:
    """A person has looked at the bench."""
    tries = (main(["device", str(folder), "clear"]) for _ in range(3))
    assert 0 in tries


class _Looks:
    """Counts; at a given look, of all ("120"), at the journal ("j12") or in a step ("s3"), the process is killed, and
    others with it."""

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
    savez, write, receive = np.savez, MasterJournal._write, NodeWire.receive

    def savez_by_halves(file: Any, **arrays: Any) -> None:
        savez(file, **dict(list(arrays.items())[: len(arrays) // 2]))
        file.flush()
        look()
        file.seek(0)
        file.truncate()
        savez(file, **arrays)

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

    np.savez = savez_by_halves  # type: ignore[assignment]
    MasterJournal._write = write_by_halves  # type: ignore[assignment]
    NodeWire.receive = receive_and_look  # type: ignore[assignment]
    NodeWire.send = look.around(NodeWire.send)
    Path.replace = look.around(Path.replace)


def _master(folder: Path, kill_at: str, others: Sequence[int]) -> None:
    look = _Looks(kill_at, others)
    _watch_master(look)
    found = session(folder)
    words = str(found) if isinstance(found, InkloopError) else f"{DONE}: {look.counts}"
    (folder / WORDS_FILE).write_text(words)


FORKING = multiprocessing.get_context("forkserver")
FORKING.set_forkserver_preload(
    [
        "inkloop.cli",
        "inkloop.bench.emulation",
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
    if process.exitcode == -signal.SIGKILL:
        return None
    assert process.exitcode == 0, process.exitcode
    return (folder / WORDS_FILE).read_text()


def head_journal(folder: Path) -> list[JournalRecord]:
    """The records of the head's memory, oldest first."""
    storage = (folder / "journal-head.bin").read_bytes()
    sectors = (storage[at : at + SECTOR_BYTES] for at in range(0, len(storage), SECTOR_BYTES))
    found = (one[at : at + RECORD_BYTES] for one in sectors for at in range(0, SECTOR_BYTES - 39, RECORD_BYTES))
    whole = [data for data in found if zlib.crc32(data[:-4]) == int.from_bytes(data[-4:], "big")]
    records = [record for data in whole for record in JournalRecord.of(data)]
    return sorted(records, key=lambda record: record.number)


def surface(folder: Path) -> Any:
    """What lies on the bed [m]."""
    data = (folder / "surface.bin").read_bytes()
    nx, ny = np.frombuffer(data, "=i4", 2, 8)
    return np.frombuffer(data, np.float64, offset=20).reshape(nx, ny)


def books(folder: Path) -> dict[int, JournalRecord]:
    """What the head remembers of each layer in the end."""
    return {record.key.layer: record for record in head_journal(folder) if record.passes}


def assert_printed_once(result: Result, run: Path, nodes: Path) -> None:
    """The part is finished; no pass was begun twice, none is missing that is not called unknown, by head and result;
    the master had recorded each one before it requested it; no wet ink was scanned; and the surface on the bed is that
    of the droplets jetted, to the bit."""
    assert result.stop_reason == "done"
    layers, known = result.dataset.sizes["layer"], books(nodes)
    assert sorted(known) == list(range(1, layers))
    unknown = {layer for layer, book in known.items() if book.unknown}
    assert set(np.flatnonzero(result.dataset.layer_unknown)) == unknown
    assert all(book.done == 0b1111 for layer, book in known.items() if layer not in unknown)
    intents = [record for record in head_journal(nodes) if record.kind is Happening.INTENT]
    begun = [record.key for record in intents if record.step is Step.PASS]
    keys = {(key.layer, key.pass_) for key in begun}
    assert len(keys) == len(begun), "a pass was begun twice"
    assert keys == {(n, k) for n, book in known.items() for k in range(4) if (book.done | book.unknown) >> k & 1}
    asked = {(record.key, record.pattern_crc) for record in MasterJournal(run).records if record.asked is Asked.PASS}
    assert {(key, known[key.layer].pattern_crc) for key in begun} <= asked
    for at, scan in enumerate(MasterJournal(run).records):
        if scan.asked is Asked.SCAN:
            _assert_no_ink_is_wet(scan.key.layer, MasterJournal(run).records[:at], known)
    height = surface(nodes)
    assert any(np.array_equal(height, one) for one in _possible(result, known)), "the surface is of other passes"


def _assert_no_ink_is_wet(layer: int, before: Sequence[MasterRecord], known: dict[int, JournalRecord]) -> None:
    """All that was begun in a layer is cured before it is scanned, and nothing of the next one is begun."""
    cured = {r.key.pass_ for r in before if (r.asked, r.event, r.key.layer) == (Asked.CURE, Event.DONE, layer)}
    begun = known[layer].done | known[layer].unknown if layer else 0
    assert {number for number in range(4) if begun >> number & 1} <= cured, f"layer {layer} was scanned wet"
    assert max((r.key.layer for r in before if r.asked is Asked.PASS), default=0) <= layer


def _possible(result: Result, known: dict[int, JournalRecord]) -> list[Any]:
    """Surfaces that fit to the scans [m]; an unknown pass may have ended at any line."""
    job = Scenario.of_text(result.scenario_text, "run").job()
    possible, colour_of = [np.zeros((job.nx, job.ny))], 2 * (np.indices((job.nx, job.ny))[0] % 2)
    colour_of = colour_of + np.indices((job.nx, job.ny))[1] % 2
    model, line = LayerModel.of(job), np.indices((job.nx, job.ny))[0]
    for layer, book in sorted(known.items()):
        pattern, measured = (result.dataset[name].values[layer] for name in ("pattern", "measured_height"))
        for number, colour in enumerate(pass_colours(job.passes, job.pass_order, job.pass_rotation, layer)):
            ends = [job.nx] if book.done >> number & 1 else range(job.nx + 1) if book.unknown >> number & 1 else []
            jetted = [np.where((colour_of == colour) & (line < end), pattern, 0).astype(np.int32) for end in ends]
            possible = [model.layer(height, one, layer) for height in possible for one in jetted or [0 * pattern]]
        fitting = (height for height in possible if np.abs(height - measured).max() < 0.51 * RESOLUTION)
        possible = list({height.tobytes(): height for height in fitting}.values())
        assert possible, f"the scan of layer {layer} is of other passes than those in the head's journal"
    return possible
