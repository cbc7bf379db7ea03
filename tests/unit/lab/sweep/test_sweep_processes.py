"""The processes of a study: what becomes of a print whose process dies, and how many fit on a machine."""

from __future__ import annotations

import multiprocessing
import os
import sys
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any, ClassVar

import pytest

from inkloop.errors import InkloopError
from inkloop_lab.sweep import local
from inkloop_lab.sweep.local import LocalProcesses, fitting
from inkloop_lab.sweep.task import Order, Record, Task

ORDER = Order("", "case.toml", None, False)
KILLED, TERMINATED, CRASHED, ABORTED = -9, -15, -11, -6


class ScriptedWorker:
    """Stands for a process: what becomes of its tasks, one after the other; an exit code, or None: it ends well."""

    fates: ClassVar[list[int | None]] = []
    made: ClassVar[list[ScriptedWorker]] = []

    def __init__(self) -> None:
        self.made.append(self)
        self.tasks: list[Task] = []
        self.code, self.ended = 0, False

    def submit(self, work: Any, order: Order, task: Task) -> Future[Record]:
        assert not self.ended
        self.tasks.append(task)
        future: Future[Record] = Future()
        fate = self.fates.pop(0)
        if fate is None:
            future.set_result(Record(task.point, task.replicate, "done"))
        else:
            self.code = fate
            future.set_exception(BrokenProcessPool("gone"))
        return future

    def end(self) -> int:
        self.ended = True
        return self.code


@pytest.fixture
def workers(monkeypatch: pytest.MonkeyPatch) -> type[ScriptedWorker]:
    ScriptedWorker.fates, ScriptedWorker.made = [], []
    monkeypatch.setattr(local, "_Worker", ScriptedWorker)
    return ScriptedWorker


def task(point: int) -> Task:
    return Task(point, 0, 7, {})


def ended(engine: LocalProcesses) -> list[Record]:
    """What the engine reports until nothing is running."""
    found: list[Record] = []
    for _ in range(30):
        found += engine.completed(1.0)
        if engine.slots:
            return found
    raise AssertionError("a task runs for ever")


def test_slots_are_the_idle_processes_and_each_task_is_performed_once(workers: type[ScriptedWorker]) -> None:
    workers.fates = [None, None, None]
    with LocalProcesses(2, ORDER) as engine:
        assert engine.slots == 2
        engine.submit(task(0))
        engine.submit(task(1))
        assert engine.slots == 0
        found = [*engine.completed(1.0)]
        assert engine.slots == 2
        engine.submit(task(2))
        found += engine.completed(1.0)
        assert sorted(record.key for record in found) == [(0, 0), (1, 0), (2, 0)]
        assert len(workers.made) == 2
    assert all(worker.ended for worker in workers.made)


def test_processes_that_print_are_ended_with_the_engine(workers: type[ScriptedWorker]) -> None:
    workers.fates = [None]
    with LocalProcesses(2, ORDER) as engine:
        engine.submit(task(0))
    assert [worker.ended for worker in workers.made] == [True, True]


@pytest.mark.parametrize("fates", [[KILLED] * 9, [TERMINATED] * 9, [CRASHED], [KILLED, CRASHED, TERMINATED]])
def test_print_whose_process_dies_is_printed_again_in_a_new_one(
    fates: list[int], workers: type[ScriptedWorker]
) -> None:
    workers.fates = [*fates, None]
    with LocalProcesses(1, ORDER) as engine:
        engine.submit(task(3))
        (record,) = ended(engine)
    assert (record.key, record.status, record.error) == ((3, 0), "done", "")
    assert [[each.key for each in worker.tasks] for worker in workers.made] == [[(3, 0)]] * (len(fates) + 1)
    assert all(worker.ended for worker in workers.made)


@pytest.mark.parametrize(
    ("fates", "message"),
    [
        ([CRASHED, CRASHED], "its process was ended by SIGSEGV every time: native code crashed"),
        ([KILLED, ABORTED, KILLED, CRASHED], "its process was ended by SIGABRT every time: native code crashed"),
        ([3, 3], "its process was ended by exit code 3 every time"),
        ([KILLED] * 10, "its process was killed 10 times; the memory may be exhausted: --workers 1"),
    ],
)
def test_print_that_ends_its_process_again_and_again_has_failed(
    fates: list[int], message: str, workers: type[ScriptedWorker]
) -> None:
    workers.fates = [*fates, None]
    with LocalProcesses(1, ORDER) as engine:
        engine.submit(task(3))
        (record,) = ended(engine)
        assert (record.key, record.status, record.error) == ((3, 0), "failed", message)
        engine.submit(task(4))  # the process that replaced it goes on
        assert [each.status for each in ended(engine)] == ["done"]


def test_deaths_of_one_print_are_not_counted_for_another(workers: type[ScriptedWorker]) -> None:
    workers.fates = [CRASHED, None, CRASHED, None]
    with LocalProcesses(1, ORDER) as engine:
        for point in (0, 1):
            engine.submit(task(point))
            assert [record.status for record in ended(engine)] == ["done"]


@pytest.mark.parametrize(
    ("asked", "threads", "found", "note"),
    [
        (None, 1, 6, ""),
        (None, 4, 1, ""),
        (None, 8, 1, ""),
        (6, 1, 6, ""),
        (2, 3, 2, ""),
        (7, 1, 6, "7 processes are more than 6 cores: 6 print"),
        (4, 2, 3, "4 processes, 2 threads in each, are more than 6 cores: 3 print"),
        (3, 4, 1, "3 processes, 4 threads in each, are more than 6 cores: 1 prints"),
    ],
)
def test_threads_of_all_processes_have_a_core_each(
    asked: int | None, threads: int, found: int, note: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: set(range(6)), raising=False)
    assert fitting(asked, threads) == (found, note)
    with pytest.raises(InkloopError, match="--workers is 0; expected a number of processes from 1"):
        fitting(0, threads)


@pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")
def test_process_has_a_thread_for_each_library_and_ends_with_its_engine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setenv("MKL_NUM_THREADS", "3")
    others = set(multiprocessing.active_children())
    with LocalProcesses(1, ORDER) as engine:
        engine.submit(task(0))
        (process,) = set(multiprocessing.active_children()) - others
        variables = Path(f"/proc/{process.pid}/environ").read_bytes().split(b"\0")
    assert {b"OMP_NUM_THREADS=1", b"MKL_NUM_THREADS=3"} <= set(variables)
    assert "OMP_NUM_THREADS" not in os.environ
    assert set(multiprocessing.active_children()) == others
