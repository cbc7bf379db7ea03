"""Processes of this machine, one print at a time in each.

Every process is a pool of its own, so that the death of one costs no other print. A pool of several processes breaks as
a whole, also that of loky.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from multiprocessing.connection import wait
from queue import SimpleQueue
from typing import Any, TypeVar

from inkloop.errors import InkloopError
from inkloop_lab.sweep.engine import Site
from inkloop_lab.sweep.task import Order, perform

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
T = TypeVar("T")


class Processes(Executor):
    """An executor of so many processes, which start with their first call. Leaving its block ends them at once.

    A call whose process dies raises BrokenProcessPool; another process takes its place.
    """

    def __init__(self, workers: int) -> None:
        self._idle: SimpleQueue[ProcessPoolExecutor] = SimpleQueue()
        self._others = set(multiprocessing.active_children())
        for _ in range(workers):
            self._idle.put(_pool())

    def submit(self, call: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Begin a call; waits while all processes are busy."""
        pool = self._idle.get()
        with _one_thread_each():
            try:
                future = pool.submit(call, *args, **kwargs)
            except BrokenProcessPool:  # it died while it was idle
                pool = _pool()
                future = pool.submit(call, *args, **kwargs)
        future.add_done_callback(
            lambda ended: self._idle.put(_pool() if isinstance(ended.exception(), BrokenProcessPool) else pool)
        )
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End all processes at once."""
        own = set(multiprocessing.active_children()) - self._others
        for process in own:
            process.kill()
        for process in own:
            process.join()


@contextmanager
def on_processes(workers: int, order: Order) -> Iterator[Site]:
    """A site of so many processes."""
    with Processes(workers) as executor:
        yield Site(executor, partial(perform, order), lambda: workers, BrokenProcessPool)


def _pool() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), initializer=_begin)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes that are started within the block leave the cores to each other."""
    added = {name: "1" for name in _THREADS if name not in os.environ}
    os.environ.update(added)
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]


def _begin() -> None:
    """In a new process: Ctrl-C is the parent's, and the process ends when the parent has ended, however that was."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)


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
