"""A study on a cluster without one: who is asked, other versions, files that come along."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from inkloop import __version__
from inkloop.errors import InkloopError
from inkloop_lab.sweep import cluster
from inkloop_lab.sweep.bundle import Bundle
from inkloop_lab.sweep.cluster import on_cluster, perform_unpacked
from inkloop_lab.sweep.task import Order, Record, Task

ADDRESS = "tcp://127.0.0.1:8786"
ORDER, BUNDLE = Order("text", "/here/case/case.toml", None, False), Bundle("text", "case/case.toml", {"ink.toml": b"a"})


class Client:
    """Stands for the client of Dask; it is its own executor."""

    def __init__(self, address: str, timeout: float) -> None:
        if address != ADDRESS:
            raise OSError("no route")
        self.status, self.workers = "running", 2
        self.calls: list[str] = []

    def get_executor(self, pure: bool) -> Client:
        assert not pure  # the same task again is another print
        return self

    def nthreads(self) -> list[int]:
        return [1] * self.workers

    def shutdown(self, wait: bool) -> None:
        self.calls.append("wait" if wait else "cancel")

    def close(self, timeout: float) -> None:
        self.calls.append("close")


@pytest.fixture
def dask(monkeypatch: pytest.MonkeyPatch) -> Any:
    made: Any = ModuleType("distributed")
    made.Client, made.KilledWorker = Client, type("KilledWorker", (Exception,), {})
    monkeypatch.setitem(sys.modules, "distributed", made)
    return made


@pytest.mark.parametrize(("status", "calls"), [("running", ["cancel", "close"]), ("closed", ["close"])])
def test_cluster_gets_two_tasks_for_each_worker_and_is_left_without_any(
    status: str, calls: list[str], dask: Any
) -> None:
    with on_cluster(ADDRESS, ORDER, BUNDLE) as site:
        client: Any = site.executor
        assert (site.slots(), site.death) == (4, dask.KilledWorker)
        client.workers = 0
        assert site.slots() == 2  # a worker is expected
        client.status = status
    assert client.calls == calls


def test_scheduler_that_does_not_answer_is_named(dask: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    with (
        pytest.raises(InkloopError, match="--scheduler tcp://nowhere:1: no scheduler answers there; start one with"),
        on_cluster("tcp://nowhere:1", ORDER, BUNDLE),
    ):
        pass
    monkeypatch.setitem(sys.modules, "distributed", None)
    with (
        pytest.raises(InkloopError, match=r"--scheduler needs the package distributed: pip install 'inkloop\[dask\]'"),
        on_cluster(ADDRESS, ORDER, BUNDLE),
    ):
        pass


def test_worker_unpacks_the_files_once_and_prints_from_them(
    dask: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dask.get_worker = lambda: SimpleNamespace(local_directory=str(tmp_path))
    seen: list[Path] = []

    def perform(order: Order, task: Task) -> Record:
        seen.append(Path(order.source))
        return Record(task.point, task.replicate, "done")

    monkeypatch.setattr(cluster, "perform", perform)
    for point in (0, 1):
        assert perform_unpacked(ORDER, BUNDLE, __version__, Task(point, 0, 7, {})).key == (point, 0)
    assert seen[0] == seen[1]
    assert seen[0].relative_to(tmp_path).parts[1:] == ("case", "case.toml")
    assert seen[0].read_text() == "text"
    assert (seen[0].parent.parent / "ink.toml").read_bytes() == b"a"
    seen[0].unlink()  # a folder that was cleaned up
    perform_unpacked(ORDER, BUNDLE, __version__, Task(2, 0, 7, {}))
    assert seen[2].is_file()
    with pytest.raises(InkloopError, match=f"a worker of the cluster has inkloop {__version__}, this command 0; inst"):
        perform_unpacked(ORDER, BUNDLE, "0", Task(3, 0, 7, {}))
    assert len(seen) == 3
