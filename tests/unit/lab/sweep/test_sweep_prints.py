"""Prints of a study: what goes with a scenario, the record of a print, processes that die, a cluster."""

from __future__ import annotations

import ctypes
import json
import multiprocessing
import os
import signal
import sys
import time
from collections import Counter
from concurrent.futures import CancelledError
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from inkloop import __version__
from inkloop.errors import ComponentError, InkloopError, ResultError
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop_lab.sweep import sites
from inkloop_lab.sweep import task as tasks
from inkloop_lab.sweep.dataset import FAILING
from inkloop_lab.sweep.folder import StudyFolder
from inkloop_lab.sweep.sites import Processes, fitting, on_cluster, perform_unpacked
from inkloop_lab.sweep.task import Bundle, Order, Record, Task, name_of, perform
from support.places import SCENARIOS
from support.sweeps import SCENARIO, Shuffled, record, study, swept

TWO = '[vary]\n"components.controller.alpha" = [0.5, 0.8]\n'
WORK = {"components.controller.horizon": 1, "components.controller.annealing_sweeps": 1}


def ordered(runs: Path | None, *, with_height: bool = False) -> Order:
    return Order(SCENARIO.read_text(), str(SCENARIO), None if runs is None else str(runs), with_height)


@pytest.mark.parametrize(("deaths", "status"), [(0, "done"), (2, "done"), (3, "failed")])
@pytest.mark.parametrize("slots", [1, 2])
def test_print_whose_process_dies_is_printed_again_and_has_failed_after_three_deaths(
    slots: int, deaths: int, status: str, tmp_path: Path
) -> None:
    begun = Counter[tuple[int, int]]()

    def deadly(task: Task) -> Record:
        begun[task.key] += 1
        if task.point and begun[task.key] <= deaths:
            raise BrokenProcessPool("gone")
        return record(task, std=1e-6)

    _, _, seen = swept(study(tmp_path, TWO), tmp_path / "out", Shuffled(deadly, slots))
    assert {each.key: each.status for each in seen} == {(0, 0): "done", (1, 0): status}
    assert begun == {(0, 0): 1, (1, 0): min(deaths + 1, 3)}  # deaths of one print cost no other
    message = "its process died 3 times: native code crashes, or the memory is exhausted (then --workers 1)"
    assert [each.error for each in seen if each.point] == [message if status == "failed" else ""]


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (ResultError("the disk is full"), "^the disk is full$"),
        (CancelledError(), "^the scheduler of the cluster is gone"),
        (KeyError("lost"), "^print 0000[01]-0000: .*lost"),
    ],
)
def test_error_that_is_none_of_the_print_ends_the_study(error: Exception, message: str, tmp_path: Path) -> None:
    def broken(task: Task) -> Record:
        raise error

    with pytest.raises(InkloopError, match=message):
        swept(study(tmp_path, TWO), tmp_path / "out", Shuffled(broken))


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
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: set(range(6)), raising=False)
    assert fitting(asked, threads) == (found, note)
    with pytest.raises(InkloopError, match="--workers is 0; expected a number of processes from 1"):
        fitting(0, threads)


@pytest.mark.system
def test_process_that_dies_costs_its_own_call_only_and_all_end_with_the_executor(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setenv("MKL_NUM_THREADS", "3")
    others = set(multiprocessing.active_children())
    with Processes(2) as executor:
        crash, one = executor.submit(ctypes.string_at, 0), executor.submit(os.getenv, "OMP_NUM_THREADS")
        assert isinstance(crash.exception(), BrokenProcessPool)
        assert one.result() == "1"
        three, pid = executor.submit(os.getenv, "MKL_NUM_THREADS"), executor.submit(os.getpid)
        assert three.result() == "3"
        idle = pid.result()
        os.kill(idle, signal.SIGKILL)
        for process in set(multiprocessing.active_children()) - others:
            if process.pid == idle:
                process.join()
        busy = [executor.submit(signal.pause) for _ in range(2)]
        while len(set(multiprocessing.active_children()) - others) < 2 and not any(each.done() for each in busy):
            time.sleep(0.01)  # one of them may have gone to the process that has died
    assert all(isinstance(each.exception(), BrokenProcessPool) for each in busy)
    assert "OMP_NUM_THREADS" not in os.environ
    assert set(multiprocessing.active_children()) == others


ADDRESS = "tcp://127.0.0.1:8786"
ORDER, BUNDLE = Order("text", "/here/case/case.toml", None, False), Bundle("text", "case/case.toml", {"ink.toml": b"a"})
OTHER = Bundle("other", BUNDLE.place, {"ink.toml": b"b"})


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

    monkeypatch.setattr(sites, "perform", perform)
    for point in (0, 1):
        assert perform_unpacked(ORDER, BUNDLE, __version__, Task(point, 0, 7, {})).key == (point, 0)
    assert seen[0] == seen[1]
    assert seen[0].relative_to(tmp_path).parts[1:] == ("case", "case.toml")
    assert seen[0].read_text() == "text"
    assert (seen[0].parent.parent / "ink.toml").read_bytes() == b"a"
    seen[0].unlink()  # a folder that was cleaned up
    perform_unpacked(ORDER, BUNDLE, __version__, Task(2, 0, 7, {}))
    assert seen[2].is_file()
    for point in (3, 5):  # a worker serves two studies in turn
        perform_unpacked(ORDER, OTHER, __version__, Task(point, 0, 7, {}))
        perform_unpacked(ORDER, BUNDLE, __version__, Task(point + 1, 0, 7, {}))
    assert [path.read_text() for path in seen[3:]] == ["other", "text"] * 2
    assert [(path.parents[1] / "ink.toml").read_bytes() for path in seen[3:]] == [b"b", b"a"] * 2
    assert seen[3:] == [seen[3], seen[2]] * 2
    with pytest.raises(InkloopError, match=f"a worker of the cluster has inkloop {__version__}, this command 0; inst"):
        perform_unpacked(ORDER, BUNDLE, "0", Task(3, 0, 7, {}))
    assert len(seen) == 7


def test_scenario_with_its_files_is_the_same_in_another_folder(tmp_path: Path) -> None:
    for name in ("lithophane", "bracket"):
        scenario = Scenario.load(SCENARIOS / f"{name}.toml")
        bundle = Bundle.of(scenario.text, SCENARIOS / f"{name}.toml")
        assert bundle.files
        assert Scenario.load(bundle.write(tmp_path / name)).part_sha256 == scenario.part_sha256


def test_bundle_of_other_files_has_another_fingerprint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = tmp_path / "case" / "case.toml"
    source.parent.mkdir()
    (tmp_path / "ink.toml").write_text("a = 1\n")
    text = 'ink = "../ink.toml"\nother = "nothing.toml"\nabsolute = "/etc/hostname"\nup = ".."\n'
    found = Bundle.of(text, source)
    assert (found.place, dict(found.files)) == ("case/case.toml", {"ink.toml": b"a = 1\n"})
    assert found.sha256 == Bundle.of(text, source).sha256
    (tmp_path / "ink.toml").write_text("a = 2\n")
    assert found.sha256 != Bundle.of(text, source).sha256
    source.with_name("more.toml").write_text("")
    named = Bundle.of("", source, [["more.toml", 3], {"k": "../ink.toml"}])
    assert sorted(named.files) == ["case/more.toml", "ink.toml"]
    monkeypatch.setattr(tasks, "BYTES_MAX", 5)
    with pytest.raises(ResultError, match="its files have 0 MB, of at most 0; put large ones"):
        Bundle.of(text, source)


@pytest.mark.parametrize(
    ("text", "files"),
    [
        ('part = "layers.json"', ["layers.json", "slices/a.png"]),
        ('part = "slices"', ["slices/a.png", "slices/b.png"]),
        ('kind = "pack.inner:Plant"', ["pack/__init__.py", "pack/inner.py"]),
        ('kind = "mine:Plant"', ["mine.py"]),
    ],
)
def test_manifests_folders_and_classes_bring_what_they_name(text: str, files: list[str], tmp_path: Path) -> None:
    for name in ("slices/a.png", "slices/b.png", "pack/__init__.py", "pack/inner.py", "mine.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("")
    (tmp_path / "layers.json").write_text(json.dumps({"images": ["slices/a.png", "slices/missing.png"], "pitch": 3}))
    assert sorted(Bundle.of(text, tmp_path / "c.toml").files) == files


def test_files_below_folders_and_packages_go_along_and_others_stay(tmp_path: Path) -> None:
    for name in (
        "slices/deep/a.png",
        "pack/__init__.py",
        "pack/deep/inner.py",
        "layers.toml",
        "b.png",
        "long" * 20 + ".toml",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    (tmp_path / "layers.toml").write_text(f"image = 'b.png'\nother = '{tmp_path}/pack/__init__.py'\n")
    for text, files in (
        ('part = "slices"', ["slices/deep/a.png"]),
        ('kind = "pack:Plant"', ["pack/__init__.py", "pack/deep/inner.py"]),
        ('part = "layers.toml"', ["b.png", "layers.toml"]),
        (f'part = "{"long" * 20}.toml"', ["long" * 20 + ".toml"]),
        (f'part = "{"x" * 300}"', []),
        ('part = "../.."', []),
        ('part = "a\\nb"', []),
        ('part = ["b.png", { other = "layers.toml" }]', ["b.png", "layers.toml"]),
    ):
        assert sorted(Bundle.of(text, tmp_path / "c.toml").files) == files, text


def test_fingerprint_is_of_the_names_and_of_the_place_too() -> None:
    one = Bundle("text", "case/case.toml", {"a": b"1", "b": b"2"})
    assert one.sha256 == Bundle("text", "case/case.toml", {"b": b"2", "a": b"1"}).sha256
    others = [
        Bundle("text", "case/other.toml", one.files),
        Bundle("text", one.place, {"a": b"1", "c": b"2"}),
        Bundle("text", one.place, {"a": b"2", "b": b"1"}),
    ]
    assert len({one.sha256, *(other.sha256 for other in others)}) == 4


def test_files_may_be_as_large_as_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.toml").write_text("a = 1\n")
    monkeypatch.setattr(tasks, "BYTES_MAX", 6)
    assert Bundle.of('part = "a.toml"', tmp_path / "c.toml").files
    (tmp_path / "a.toml").write_text("a = 10\n")
    with pytest.raises(ResultError, match="its files have 0 MB"):
        Bundle.of('part = "a.toml"', tmp_path / "c.toml")


def test_print_of_a_task_is_that_of_a_run(tmp_path: Path) -> None:
    task = Task(0, 0, 5, WORK)
    found = [perform(ordered(runs, with_height=True), task) for runs in (None, tmp_path)]
    run = Result.load(tmp_path / name_of(task.key))
    for each in found:
        assert each.metrics == run.metrics()
        np.testing.assert_array_equal(each.height, run.final_height)
    broken = perform(ordered(None), Task(0, 0, 5, {"part.height_um": -1.0}))
    assert (broken.status, broken.metrics) == ("failed", {})
    assert "part.height_um is -1.0" in broken.error


@pytest.mark.parametrize(
    ("key", "value", "status"),
    [("run.layers_max", 1, "layers_max"), ("components.controller.volume_least", 0.98, "stopped")],
)
def test_print_that_is_finished_or_stopped_is_read_and_not_printed_again(
    key: str, value: float, status: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody has looked at a print that was stopped."""
    task = Task(2, 1, 5, {key: value, **WORK})
    first = perform(ordered(tmp_path), task)
    assert (first.key, first.status, first.height) == ((2, 1), status, None)
    assert (tmp_path / "00002-0001" / "result.nc").is_file()
    monkeypatch.setattr("inkloop_lab.sweep.task.print_part", None)
    again = perform(ordered(tmp_path), task)
    assert (again.status, again.metrics) == (first.status, first.metrics)
    assert (status in FAILING) is (status == "stopped")


@pytest.mark.parametrize(("keep", "stays"), [("layers = true", False), ('maps = "all"', True)])
def test_run_folder_goes_with_its_record_unless_runs_are_kept(keep: str, stays: bool, tmp_path: Path) -> None:
    own = study(tmp_path, f"{TWO}[keep]\n{keep}\n")
    place = tmp_path / "out" / "prints" / "00001-0000"
    place.mkdir(parents=True)
    bundle = Bundle.of(own.scenario.text, SCENARIO)
    StudyFolder(tmp_path / "out", own, bundle).add(Record(1, 0, "done", {"std": 1e-6}, 0.5))
    assert place.is_dir() is stays
    (found,) = StudyFolder(tmp_path / "out", own, bundle).records.values()
    assert (found.key, found.status, found.metrics, found.wall_s) == ((1, 0), "done", {"std": 1e-6}, 0.5)


@pytest.mark.parametrize("runs", [False, True])
def test_error_of_a_print_is_the_message_of_its_cause(
    runs: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run folder adds advice to the message, which names the folder: it differs from machine to machine."""
    cause, full = ComponentError("printer: out of ink"), OSError(28, "No space left on device")
    advised = ComponentError(f"{cause}\nlayers 0 to 3 are in {tmp_path}")
    advised.__cause__ = cause
    print_part = Mock(side_effect=[advised, full])
    monkeypatch.setattr("inkloop_lab.sweep.task.print_part", print_part)
    order = ordered(tmp_path if runs else None)
    found = perform(order, Task(0, 0, 5, {}))
    assert found.status == "failed"
    assert found.error.startswith("printer: out of ink")
    assert ("layers 0 to 3" in found.error) is not runs
    with pytest.raises(ResultError, match="print 00000-0000: the disk is full"):
        perform(order, Task(0, 0, 5, {}))
