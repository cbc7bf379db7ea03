"""Prints on a running Dask cluster, with or without a file system that its machines share."""

from __future__ import annotations

import sys
import tempfile
import threading
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from inkloop import __version__
from inkloop.errors import InkloopError, require
from inkloop_lab.sweep.bundle import Bundle
from inkloop_lab.sweep.local import Perform
from inkloop_lab.sweep.task import Order, Record, Task, failed, perform

if TYPE_CHECKING:
    from distributed import Future

LOSSES_MAX = 3
"""Times that the cluster gives a task up, each after several workers have died of it, before the print has failed."""
CONNECT_S = 20.0
_PRINTING = threading.Lock()
_PLACES: dict[str, Path] = {}
"""Of this worker: hash of a bundle -> its scenario, unpacked."""


class DaskCluster:
    """An engine on the cluster of a scheduler. Leaving its block cancels what is not printed.

    A worker prints one task at a time. Raises InkloopError where the scheduler or Dask is missing.
    """

    def __init__(self, address: str, order: Order, bundle: Bundle, work: Perform = perform) -> None:
        dask = require("distributed", "--scheduler")
        try:
            self._client: Any = dask.Client(address, timeout=CONNECT_S)
        except (OSError, ValueError) as error:
            raise InkloopError(
                f"--scheduler {address}: no scheduler answers there; start one with `dask scheduler`, and workers with "
                f"`dask worker {address} --nthreads 1`"
            ) from error
        self._address, self._order, self._bundle, self._work = address, order, bundle, work
        self._futures: dict[Future[Record], Task] = {}
        self._losses: dict[tuple[int, int], int] = {}

    def __enter__(self) -> DaskCluster:
        return self

    def __exit__(self, *_: object) -> None:
        if self._client.status == "running":
            self._client.cancel(list(self._futures))
        self._client.close(timeout=5)

    @property
    def slots(self) -> int:
        """Tasks that may be submitted now: two for each worker, so that none waits for this process."""
        return max(0, 2 * max(1, len(self._client.nthreads())) - len(self._futures))

    def submit(self, task: Task) -> None:
        """Hand a task to the cluster."""
        future = self._client.submit(
            perform_unpacked, self._order, self._bundle, task, __version__, self._work, pure=False
        )
        self._futures[future] = task

    def completed(self, timeout_s: float) -> Sequence[Record]:
        """Records of the tasks that have ended, after this time at the latest. Raises InkloopError of a task."""
        import distributed

        look: Any = distributed.wait
        try:
            done = look(list(self._futures), timeout=timeout_s, return_when="FIRST_COMPLETED").done
        except TimeoutError:
            if self._client.status != "running":
                raise InkloopError(f"--scheduler {self._address}: the scheduler is gone") from None
            return ()
        records = []
        for future in done:
            task = self._futures.pop(future)
            try:
                records.append(future.result())
            except distributed.KilledWorker:
                self._losses[task.key] = self._losses.get(task.key, 0) + 1
                if self._losses[task.key] < LOSSES_MAX:
                    self.submit(task)
                else:
                    records.append(failed(task, "workers of the cluster died of it again and again"))
            except InkloopError:
                raise
            except Exception as error:  # of Dask: a task that it has cancelled, a connection that it has lost
                if self._client.status != "running" or future.cancelled():
                    raise InkloopError(f"--scheduler {self._address}: the scheduler is gone ({error})") from error
                raise InkloopError(f"--scheduler {self._address}: {type(error).__name__}: {error}") from error
        return records


def perform_unpacked(order: Order, bundle: Bundle, task: Task, version: str, work: Perform) -> Record:
    """On a worker: print a task of a scenario whose files came along. One print at a time.

    Raises InkloopError where the worker has another inkloop.
    """
    if version != __version__:
        raise InkloopError(f"a worker of the cluster has inkloop {__version__}, this command {version}; install one")
    with _PRINTING:
        return work(replace(order, source=str(_unpacked(bundle))), task)


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
