"""A study on a cluster whose scheduler and workers are made up: losses, other versions, files that come along."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from inkloop import __version__
from inkloop.errors import InkloopError, ResultError
from inkloop_lab.sweep.bundle import Bundle
from inkloop_lab.sweep.cluster import DaskCluster, perform_unpacked
from inkloop_lab.sweep.task import Order, Record, Task

ADDRESS = "tcp://127.0.0.1:8786"
ORDER, BUNDLE = Order("text", "/here/case/case.toml", None, False), Bundle("text", "case/case.toml", {"ink.toml": b"a"})


class Lost(Exception):
    """Stands for distributed.KilledWorker."""


class Future:
    """A task on the made-up cluster; `fate` is raised, or returned by `result`."""

    def __init__(self, task: Task, fate: Any) -> None:
        self.task, self.fate = task, fate

    def result(self) -> Any:
        if isinstance(self.fate, Exception):
            raise self.fate
        return Record(self.task.point, self.task.replicate, "done")

    def cancelled(self) -> bool:
        return self.fate == "cancelled"


class Dask(ModuleType):
    """Stands for the package; what the cluster was told is in `calls`."""

    KilledWorker = Lost

    def __init__(self) -> None:
        super().__init__("distributed")
        self.status, self.workers, self.folder = "running", 2, ""
        self.calls: list[Any] = []
        self.fates: list[Any] = []
        self.refusal: Exception | None = None
        self.ends: Callable[[list[Future]], list[Future]] = list

    def Client(self, address: str, timeout: float) -> Dask:
        if self.refusal:
            raise self.refusal
        self.calls.append(("connect", address, timeout))
        return self

    def nthreads(self) -> list[int]:
        return [1] * self.workers

    def submit(
        self, call: Any, order: Order, bundle: Bundle, task: Task, version: str, work: Any, pure: bool
    ) -> Future:
        assert (call, order, bundle, version, pure) == (perform_unpacked, ORDER, BUNDLE, __version__, False)
        return Future(task, self.fates.pop(0) if self.fates else None)

    def wait(self, futures: list[Future], timeout: float, return_when: str) -> Any:
        assert return_when == "FIRST_COMPLETED"
        done = self.ends(futures)
        if not done:
            raise TimeoutError
        return SimpleNamespace(done=done)

    def cancel(self, futures: list[Future]) -> None:
        self.calls.append(("cancel", [future.task.point for future in futures]))

    def close(self, timeout: float) -> None:
        self.calls.append("close")

    def get_worker(self) -> Any:
        if not self.folder:
            raise ValueError("no worker")
        return SimpleNamespace(local_directory=self.folder)


@pytest.fixture
def dask(monkeypatch: pytest.MonkeyPatch) -> Dask:
    made = Dask()
    monkeypatch.setitem(sys.modules, "distributed", made)
    return made


def task(point: int) -> Task:
    return Task(point, 0, 7, {})


def test_cluster_gets_two_tasks_for_each_worker(dask: Dask) -> None:
    with DaskCluster(ADDRESS, ORDER, BUNDLE) as engine:
        assert engine.slots == 4
        for point in range(3):
            engine.submit(task(point))
        assert engine.slots == 1
        dask.workers = 0
        assert engine.slots == 0  # one worker at least is expected, and has more than enough
        dask.ends = lambda futures: futures[:2]
        assert [record.key for record in engine.completed(0.1)] == [(0, 0), (1, 0)]
        assert engine.slots == 1
        dask.ends = lambda futures: []
        assert engine.completed(0.1) == ()
    assert dask.calls[0][:2] == ("connect", ADDRESS)
    assert dask.calls[1:] == [("cancel", [2]), "close"]


def test_scheduler_that_is_gone_cancels_nothing(dask: Dask) -> None:
    with DaskCluster(ADDRESS, ORDER, BUNDLE) as engine:
        engine.submit(task(0))
        dask.status, dask.ends = "closed", lambda futures: []
        with pytest.raises(InkloopError, match=r"the scheduler is gone$"):
            engine.completed(0.1)
    assert dask.calls[1:] == ["close"]


@pytest.mark.parametrize(("losses", "status"), [(2, "done"), (3, "failed")])
def test_task_that_its_workers_die_of_is_given_up_after_three_losses(losses: int, status: str, dask: Dask) -> None:
    dask.fates = [Lost()] * losses
    with DaskCluster(ADDRESS, ORDER, BUNDLE) as engine:
        engine.submit(task(5))
        found: list[Record] = []
        for _ in range(losses + 1):
            if engine.slots < 4:
                found += engine.completed(0.1)
    assert [(record.key, record.status) for record in found] == [((5, 0), status)]
    assert ("died of it again and again" in found[0].error) == (status == "failed")


@pytest.mark.parametrize(
    ("fate", "message"),
    [
        (ResultError("the disk is full"), "^the disk is full$"),
        (KeyError("lost"), f"^--scheduler {ADDRESS}: KeyError: 'lost'$"),
    ],
)
def test_error_of_a_task_ends_the_study(fate: Exception, message: str, dask: Dask) -> None:
    dask.fates = [fate]
    with DaskCluster(ADDRESS, ORDER, BUNDLE) as engine:
        engine.submit(task(0))
        with pytest.raises(InkloopError, match=message):
            engine.completed(0.1)


def test_scheduler_that_does_not_answer_is_named(dask: Dask, monkeypatch: pytest.MonkeyPatch) -> None:
    dask.refusal = OSError("no route")
    with pytest.raises(InkloopError, match=f"--scheduler {ADDRESS}: no scheduler answers there; start one with"):
        DaskCluster(ADDRESS, ORDER, BUNDLE)
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InkloopError, match=r"--scheduler needs the package distributed: pip install 'inkloop\[dask\]'"):
        DaskCluster(ADDRESS, ORDER, BUNDLE)


def test_worker_unpacks_the_files_once_and_prints_from_them(dask: Dask, tmp_path: Path) -> None:
    dask.folder = str(tmp_path)
    bundle, seen = Bundle("text of a test", "case/case.toml", {"ink.toml": b"a"}), []

    def work(order: Order, task: Task) -> Record:
        seen.append(Path(order.source))
        return Record(task.point, task.replicate, "done")

    for point in (0, 1):
        assert perform_unpacked(ORDER, bundle, task(point), __version__, work).key == (point, 0)
    assert seen[0] == seen[1]
    assert seen[0].relative_to(tmp_path).parts[1:] == ("case", "case.toml")
    assert seen[0].read_text() == "text of a test"
    assert (seen[0].parent.parent / "ink.toml").read_bytes() == b"a"
    seen[0].unlink()  # a folder that was cleaned up
    perform_unpacked(ORDER, bundle, task(2), __version__, work)
    assert seen[2].is_file()
    with pytest.raises(
        InkloopError, match=f"a worker of the cluster has inkloop {__version__}, this command 0; install"
    ):
        perform_unpacked(ORDER, bundle, task(3), "0", work)
    assert len(seen) == 3
