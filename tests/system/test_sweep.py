"""Studies in processes and on a cluster: the file is the same however often they are killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from inkloop.cli import main
from inkloop.master.interrupt import deferred
from inkloop.results import netcdf
from inkloop.results.result import Result
from inkloop.studies.sweep import dataset
from inkloop.studies.sweep.bundle import Bundle
from inkloop.studies.sweep.engine import Engine, carry_out
from inkloop.studies.sweep.journal import Journal
from inkloop.studies.sweep.local import LocalProcesses
from inkloop.studies.sweep.plan import PointsPlan
from inkloop.studies.sweep.report import sweep_of
from inkloop.studies.sweep.study import Study
from inkloop.studies.sweep.task import Order, perform
from support.prints import quick_cuboid
from support.sweeps import Shuffled

COMMAND = "import sys; from inkloop.cli import main; sys.exit(main(sys.argv[1:]))"
KILLS = 20
TEXT = """
[vary]
"part.size_x_um" = [2106.048, 4000.0]   # the wider one does not fit on 12 cells: one point of four fails
"grid.nx" = [12, 18]
[seeds]
count = {seeds}
[keep]
{keep}
"""


def study_file(folder: Path, seeds: int = 1, keep: str = "layers = true") -> Path:
    path = folder / "study.toml"
    path.write_text(f'scenario = "{quick_cuboid()}"\n{TEXT.format(seeds=seeds, keep=keep)}')
    return path


def undisturbed(path: Path, folder: Path) -> xr.Dataset:
    """The study printed one by one in this process, in memory."""
    study = Study.load(path)
    order = Order(study.scenario.text, study.scenario.source, None, False)
    return printed(path, folder, Shuffled(lambda task: perform(order, task), slots=1))


def printed(path: Path, folder: Path, engine: Engine) -> xr.Dataset:
    study = Study.load(path)
    plan = PointsPlan(study)
    folder.mkdir(exist_ok=True)
    with Journal(folder, study, Bundle.of(study.scenario.text, Path(study.scenario.source))) as journal:
        with deferred() as interrupted:
            assert carry_out(plan, engine, journal, interrupted, lambda record: None)
        dataset.write(sweep_of(study, journal, plan), folder)
    return netcdf.read(folder / dataset.SWEEP_FILE)


def assert_same(one: xr.Dataset, other: xr.Dataset) -> None:
    """Every value but the wall times, and so every byte."""
    first, second = (each.assign(wall_s=each["wall_s"] * 0.0) for each in (one, other))
    xr.testing.assert_identical(first, second)
    assert bytes(netcdf.packed(first)) == bytes(netcdf.packed(second))


def begun(*words: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", COMMAND, "sweep", *words, "--no-pictures"]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def workers_of(process: subprocess.Popen[str]) -> list[int]:
    """Its children that print: multiprocessing names them by `spawn_main`."""
    with suppress(OSError):
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        return [int(child) for child in children if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()]
    return []


def wait_until(holds: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    while not holds():
        assert process.poll() is None, process.communicate()
        time.sleep(0.005)


def wait_for_changes(out: Path, count: int, process: subprocess.Popen[str]) -> None:
    """Until so many layers or records have been written, or the study has ended: moments that no clock decides."""

    def look() -> list[object]:
        states = sorted(out.glob("prints/*/layers/*.npz"))
        return [states, (out / "records.jsonl").is_file() and (out / "records.jsonl").stat().st_size]

    seen = look()
    while count and process.poll() is None:
        time.sleep(0.002)
        if (now := look()) != seen:
            seen, count = now, count - 1


def is_alive(pid: int) -> bool:
    with suppress(OSError):
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    return False


def end(pid: int) -> None:
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)


@pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")
@pytest.mark.long
def test_study_whose_process_is_killed_in_a_print_resumes_to_the_same_file(tmp_path: Path) -> None:
    path, out = study_file(tmp_path, keep='maps = "all"'), tmp_path / "out"
    expected = undisturbed(path, tmp_path / "undisturbed")
    with begun(str(path), "--out", str(out), "--workers", "1") as process:
        wait_until(lambda: bool(list(out.glob("prints/00001-*/layers/0003.npz"))), process)
        (worker,) = workers_of(process)
        process.kill()
    assert main(["sweep", str(path), "--out", str(out), "--resume", "--workers", "1", "--no-pictures"]) == 3
    assert not is_alive(worker)
    assert_same(netcdf.read(out / "sweep.nc"), expected)
    assert expected["status"].values.ravel().tolist() == [1, 1, 5, 1]
    assert "part reaches beyond the grid of 12 x 12 cells" in expected["error"].values.ravel()[2]
    assert Result.load(out / "prints" / "00001-0000").run["resumed_after_layer"] >= 3


@pytest.mark.long
@pytest.mark.parametrize("workers", [1, 2])
def test_study_killed_at_random_moments_resumes_to_the_same_file(workers: int, tmp_path: Path) -> None:
    path, out, rng = study_file(tmp_path, seeds=10), tmp_path / "out", np.random.default_rng(workers)
    expected = undisturbed(path, tmp_path / "undisturbed")
    for kill in range(KILLS):
        words = [str(path), "--out", str(out), "--workers", str(workers), *(["--resume"] if kill else [])]
        with begun(*words) as process:
            wait_until((out / "study.json").is_file, process)
            if kill % 2 == 0:
                wait_for_changes(out, int(rng.integers(0, 12)), process)
                process.kill()
                continue
            for _ in range(2):
                wait_for_changes(out, int(rng.integers(1, 6)), process)
                for worker in workers_of(process)[:1]:
                    end(worker)
            process.send_signal(signal.SIGINT)
            shown, _ = process.communicate()
            assert process.returncode in (130, 3)
            assert process.returncode == 3 or "continue with `inkloop sweep" in shown
    assert main(["sweep", str(path), "--out", str(out), "--resume", "--no-pictures"]) == 3
    assert_same(netcdf.read(out / "sweep.nc"), expected)


@pytest.mark.long
@pytest.mark.parametrize("workers", [1, 2, 4])
@pytest.mark.parametrize("keep", ["layers = true", 'maps = "none"'])
def test_any_number_of_workers_gives_the_same_file(workers: int, keep: str, tmp_path: Path) -> None:
    path = study_file(tmp_path, seeds=3, keep=keep)
    study = Study.load(path)
    runs = str(tmp_path / "out" / "prints") if "layers" in keep else None
    order = Order(study.scenario.text, study.scenario.source, runs, False)
    with LocalProcesses(workers, order) as engine:
        found = printed(path, tmp_path / "out", engine)
    assert_same(found, undisturbed(path, tmp_path / "undisturbed"))


@pytest.fixture
def dask_workers(tmp_path: Path) -> Iterator[tuple[str, list[int]]]:
    """Address and processes of a cluster of two workers that share no folder with this process."""
    distributed = pytest.importorskip("distributed", reason="inkloop[dask] is not installed")
    folder = tmp_path / "workers"
    options = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "local_directory": str(folder)}
    with distributed.LocalCluster(**options, dashboard_address=None, silence_logs=50) as cluster:
        yield cluster.scheduler_address, [worker.process.pid for worker in cluster.workers.values()]


@pytest.mark.long
def test_cluster_of_which_a_worker_is_killed_gives_the_same_file(
    dask_workers: tuple[str, list[int]], tmp_path: Path
) -> None:
    address, processes = dask_workers
    path, out = study_file(tmp_path, seeds=2, keep='maps = "none"'), tmp_path / "out"
    expected = undisturbed(path, tmp_path / "undisturbed")
    with begun(str(path), "--out", str(out), "--scheduler", address) as process:
        wait_until(lambda: (out / "records.jsonl").is_file() and (out / "records.jsonl").stat().st_size > 0, process)
        end(processes[0])
        shown, errors = process.communicate()
    assert process.returncode == 3, shown + errors
    assert_same(netcdf.read(out / "sweep.nc"), expected)
    assert list((tmp_path / "workers").rglob("cuboid.toml"))
