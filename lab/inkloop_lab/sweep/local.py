"""Prints in processes of this machine, one print at a time in each; a process that ends is replaced.

Every process has a pool of its own, so that a death is the death of one known print and costs no other.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait as wait_for
from typing import Protocol

from inkloop.errors import InkloopError
from inkloop_lab.sweep.task import Order, Record, Task, failed, perform

CRASHES_MAX, KILLS_MAX = 2, 10
"""A print has failed after so many crashes of native code in its process, or kills of its process from outside."""
_KILL, _TERMINATE = 9, 15
_KILLS = (_KILL, _TERMINATE)
"""Signals that no fault of native code raises."""
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class Perform(Protocol):
    """What a process does with a task: `task.perform`, or another function of a module."""

    def __call__(self, order: Order, task: Task) -> Record: ...


class LocalProcesses:
    """An engine of so many processes. Leaving its block ends them at once."""

    def __init__(self, workers: int, order: Order, work: Perform = perform) -> None:
        self._order, self._work = order, work
        self._idle = [_Worker() for _ in range(workers)]
        self._busy: dict[Future[Record], tuple[_Worker, Task]] = {}
        self._deaths: dict[tuple[int, int], list[int]] = {}
        self._given_up: list[Record] = []

    def __enter__(self) -> LocalProcesses:
        return self

    def __exit__(self, *_: object) -> None:
        for worker in [*self._idle, *(worker for worker, _ in self._busy.values())]:
            worker.end()

    @property
    def slots(self) -> int:
        """Tasks that may be submitted now."""
        return len(self._idle)

    def submit(self, task: Task) -> None:
        """Begin a task in an idle process."""
        worker = self._idle.pop()
        self._busy[worker.submit(self._work, self._order, task)] = worker, task

    def completed(self, timeout_s: float) -> Sequence[Record]:
        """Records of the tasks that have ended, after this time at the latest. Raises InkloopError of a task."""
        done, _ = wait(self._busy, timeout_s, FIRST_COMPLETED)
        records: list[Record] = []
        for future in done:
            worker, task = self._busy.pop(future)
            try:
                records.append(future.result())
            except BrokenProcessPool:
                code = worker.end()
                worker = _Worker()
                if (record := self._after_death(task, code)) is not None:
                    records.append(record)
                else:
                    self._busy[worker.submit(self._work, self._order, task)] = worker, task
                    continue
            self._idle.append(worker)
        return records

    def _after_death(self, task: Task, code: int) -> Record | None:
        """The record of a task that cannot be printed, None where it is to be printed again."""
        deaths = self._deaths.setdefault(task.key, [])
        deaths.append(code)
        kills = sum(-each in _KILLS for each in deaths)
        if len(deaths) - kills >= CRASHES_MAX:
            crash = next(each for each in deaths if -each not in _KILLS)
            cause = ": native code crashed" if crash < 0 else ""
            return failed(task, f"its process was ended by {_name(crash)} every time{cause}")
        if kills >= KILLS_MAX:
            return failed(task, f"its process was killed {KILLS_MAX} times; the memory may be exhausted: --workers 1")
        return None


class _Worker:
    """A process that is started with its first task."""

    def __init__(self) -> None:
        self._pool: ProcessPoolExecutor | None = None
        self._process: multiprocessing.process.BaseProcess | None = None

    def submit(self, work: Perform, order: Order, task: Task) -> Future[Record]:
        """Begin a task; if the process has died, the future raises BrokenProcessPool."""
        if self._pool is None:
            others = {child.pid for child in multiprocessing.active_children()}
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(1, context, initializer=_begin)
            with _OneThreadEach():
                future = self._pool.submit(work, order, task)
            started = [child for child in multiprocessing.active_children() if child.pid not in others]
            self._process = started[0] if started else None
            return future
        try:
            return self._pool.submit(work, order, task)
        except BrokenProcessPool as error:
            lost: Future[Record] = Future()
            lost.set_exception(error)
            return lost

    def end(self) -> int:
        """End the process at once; its exit code, that of a signal negative."""
        if self._pool is None:
            return 0
        if self._process is not None and self._process.is_alive():
            self._process.kill()
        self._pool.shutdown(wait=True, cancel_futures=True)
        code = self._process.exitcode if self._process is not None else None
        self._pool = self._process = None
        return -_KILL if code is None else code


class _OneThreadEach:
    """Processes that are started within the block leave the cores to each other."""

    def __enter__(self) -> None:
        self._set = {name: "1" for name in _THREADS if name not in os.environ}
        os.environ.update(self._set)

    def __exit__(self, *_: object) -> None:
        for name in self._set:
            del os.environ[name]


def _begin() -> None:
    """In a new process: Ctrl-C is the parent's, and the process ends when the parent has ended, however that was."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    wait_for([sentinel])
    os._exit(1)


def _name(code: int) -> str:
    return {-entry.value: entry.name for entry in signal.Signals}.get(code, f"exit code {code}")


def fitting(workers: int | None, threads: int) -> tuple[int, str]:
    """So many processes that all their threads have a core each, and a sentence where fewer than asked for.

    workers: as asked for, None: as many as fit; threads: of a print. Raises InkloopError for none.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if workers is not None and workers < 1:
        raise InkloopError(f"--workers is {workers}; expected a number of processes from 1")
    most = max(1, cores // threads)
    if workers is None or workers <= most:
        return workers or most, ""
    each = f", {threads} threads in each," if threads > 1 else ""
    return most, f"{workers} processes{each} are more than {cores} cores: {most} print{'s' if most == 1 else ''}"
