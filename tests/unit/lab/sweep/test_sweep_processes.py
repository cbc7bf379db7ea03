"""Processes of a study: a print whose process dies, and how many processes fit on a machine."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import time
from collections import Counter
from concurrent.futures import CancelledError
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import pytest

from inkloop.errors import InkloopError, ResultError
from inkloop_lab.sweep.processes import Processes, fitting
from inkloop_lab.sweep.task import Record, Task
from support.sweeps import Shuffled, record, study, swept

TWO = '[vary]\n"components.controller.alpha" = [0.5, 0.8]\n'


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
