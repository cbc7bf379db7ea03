"""Sites of prints: processes of this machine, one print at a time in each, or the workers of a running Dask cluster.

Every process is a pool of its own, so that the death of one costs no other print. A pool of several processes breaks as
a whole, also that of loky. The machines of a cluster may share a file system or none: files go with the print.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from multiprocessing.connection import wait
from pathlib import Path
from queue import SimpleQueue
from typing import Any, TypeVar

from inkloop import __version__
from inkloop.errors import InkloopError, require
from inkloop.limits import usable_cores
from inkloop_lab.sweep.engine import Site
from inkloop_lab.sweep.task import Bundle, Order, Record, Task, perform

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
    cores = usable_cores()
    if workers is not None and workers < 1:
        raise InkloopError(f"--workers is {workers}; expected a number of processes from 1")
    most = max(1, cores // threads)
    if workers is None or workers <= most:
        return workers or most, ""
    each = f", {threads} threads in each," if threads > 1 else ""
    return most, f"{workers} processes{each} are more than {cores} cores: {most} print{'s' if most == 1 else ''}"


CONNECT_S, CLOSE_S = 20.0, 5.0
_PRINTING = threading.Lock()
_PLACES: dict[str, Path] = {}
"""Of this worker: hash of a bundle -> its scenario, unpacked."""


@contextmanager
def on_cluster(address: str, order: Order, bundle: Bundle) -> Iterator[Site]:
    """A site of the workers of a scheduler: two tasks for each, so that none waits for this process.

    Leaving the block cancels what is not printed. Raises InkloopError where the scheduler or Dask is missing.
    """
    dask = require("distributed", "--scheduler")
    try:
        client: Any = dask.Client(address, timeout=CONNECT_S)
    except (OSError, ValueError) as error:
        raise InkloopError(
            f"--scheduler {address}: no scheduler answers there; start one with `dask scheduler`, and workers with "
            f"`dask worker {address} --nthreads 1`"
        ) from error
    executor = client.get_executor(pure=False)
    work = partial(perform_unpacked, order, bundle, __version__)
    try:
        yield Site(executor, work, lambda: 2 * max(1, len(client.nthreads())), dask.KilledWorker)
    finally:
        if client.status == "running":
            executor.shutdown(wait=False)
        client.close(timeout=CLOSE_S)


def perform_unpacked(order: Order, bundle: Bundle, version: str, task: Task) -> Record:
    """On a worker: print a task of a scenario whose files came along. One print at a time.

    Raises InkloopError where the worker has another inkloop.
    """
    if version != __version__:
        raise InkloopError(f"a worker of the cluster has inkloop {__version__}, this command {version}; install one")
    with _PRINTING:
        return perform(replace(order, source=str(_unpacked(bundle))), task)


def _unpacked(bundle: Bundle) -> Path:
    """The scenario of a bundle on this machine, unpacked once; classes of other bundles are forgotten."""
    if (found := _PLACES.get(bundle.sha256)) is None or not found.exists():
        folder = Path(tempfile.mkdtemp(prefix="inkloop-study-", dir=_local_directory()))
        found = _PLACES[bundle.sha256] = bundle.write(folder)
    others = [str(place.parent) for place in _PLACES.values() if place != found]
    for name, module in list(sys.modules.items()):
        file: Any = getattr(module, "__file__", None)
        if file and str(Path(file).parent) in others:
            del sys.modules[name]
    return found


def _local_directory() -> str | None:
    """The folder of this worker, which goes with it."""
    from distributed import get_worker

    try:
        return str(get_worker().local_directory)
    except ValueError:
        return None
