"""Workers of a running Dask cluster, with or without a file system that its machines share."""

from __future__ import annotations

import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from inkloop import __version__
from inkloop.errors import InkloopError, require
from inkloop_lab.sweep.bundle import Bundle
from inkloop_lab.sweep.engine import Site
from inkloop_lab.sweep.task import Order, Record, Task, perform

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
