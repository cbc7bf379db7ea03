"""Studies in processes and on a cluster: the file is the same however often they are killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from glob import glob
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from inkloop.cli import main
from inkloop.master.interrupt import deferred
from inkloop.results import netcdf
from inkloop.results.result import Result
from inkloop_lab.sweep import dataset
from inkloop_lab.sweep.engine import Site, carry_out
from inkloop_lab.sweep.folder import StudyFolder
from inkloop_lab.sweep.plan import PointsPlan
from inkloop_lab.sweep.report import sweep_of
from inkloop_lab.sweep.sites import on_cluster, on_processes
from inkloop_lab.sweep.study import Study
from inkloop_lab.sweep.task import Bundle, Order, Task, perform
from support.once_per_run import once
from support.places import SCENARIOS
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
CYLINDERS = f"""
scenario = "{SCENARIOS / "cylinder.toml"}"
[vary]
"components.controller.alpha" = [0.5, 0.6, 0.7, 0.8, 0.9]
"components.controller.horizon" = [1]
"components.controller.finish" = ["fast"]
"part.height_um" = [100.0]   # 16 of the 72 layers: a print takes a third of a second
[seeds]
count = 40
[keep]
maps = "final"
"""

OWN_RULE = """
title = "a rule of one's own"
grid = { nx = 12, ny = 11 }
part = { shape = "cuboid", size_x_um = 1000.0, size_y_um = 800.0, height_um = 22.8 }
components.controller.kind = "own:Rule"
components.printer.kind = "LayerDeposition"
components.profiler.kind = "ProfileSensor"
"""
RULE = """
class Rule:
    def __init__(self, job):
        self.job = job

    def pattern(self, height, layer):
        return self.job.mask & (layer < {layers})
"""


def study_file(folder: Path, seeds: int = 1, keep: str = "layers = true") -> Path:
    path = folder / "study.toml"
    path.write_text(f'scenario = "{quick_cuboid()}"\n{TEXT.format(seeds=seeds, keep=keep)}')
    return path


def undisturbed(path: Path, folder: Path) -> xr.Dataset:
    """The study printed one by one in this process, in memory."""
    study = Study.load(path)
    order = Order(study.scenario.text, study.scenario.source, None, study.tables.keep.maps == "final")
    return printed(path, folder, Shuffled(lambda task: perform(order, task), slots=1).site)


def printed(path: Path, folder: Path, site: Site) -> xr.Dataset:
    study = Study.load(path)
    plan = PointsPlan(study)
    folder.mkdir(exist_ok=True)
    own = StudyFolder(folder, study, Bundle.of(study.scenario.text, Path(study.scenario.source)))
    with deferred() as interrupted:
        assert carry_out(plan, site, own, interrupted, lambda record: None)
    dataset.write(sweep_of(study, own, plan), folder)
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

    def look() -> set[object]:
        # pathlib's raises where a folder goes meanwhile
        states = glob(str(out / "prints/*/layers/*.npz"))  # noqa: PTH207
        return {*states, *glob(str(out / "prints/*.json"))}  # noqa: PTH207

    seen = look()
    while count > 0 and process.poll() is None:
        time.sleep(0.002)
        now = look()
        count, seen = count - len(now - seen), now  # on a busy machine many at a time


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
        wait_until(lambda: bool(list(out.glob("prints/00001-*/layers/0004.npz"))), process)
        (worker,) = workers_of(process)
        process.kill()
    while is_alive(worker):
        time.sleep(0.005)
    (state,) = out.glob("prints/00001-*/layers/state.npz")
    with np.load(state) as saved:
        layer = saved["point"][1]
    assert main(["sweep", str(path), "--out", str(out), "--resume", "--workers", "1", "--no-pictures"]) == 3
    assert_same(netcdf.read(out / "sweep.nc"), expected)
    assert expected["status"].values.ravel().tolist() == [1, 1, 5, 1]
    assert "part reaches beyond the grid of 12 x 12 cells" in expected["error"].values.ravel()[2]
    assert Result.load(out / "prints" / "00001-0000").run["resumed_after_layer"] == layer


def kill_and_resume(
    words: list[str], out: Path, between: int, rng: np.random.Generator, workers: Callable[[Any], list[int]]
) -> None:
    """Kill a study KILLS times and let it end: in turns its own process, and two of its workers before it is stopped.

    words: of the command; between: layers or records that are written from one kill to the next, at most.
    """
    for kill in range(KILLS):
        with begun(*words, *(["--resume"] if kill else [])) as process:
            wait_until((out / "study.json").is_file, process)
            if kill % 2 == 0:
                wait_for_changes(out, int(rng.integers(0, between)), process)
                assert process.poll() is None
                process.kill()
                continue
            for _ in range(2):
                wait_for_changes(out, int(rng.integers(1, between // 2)), process)
                for worker in workers(process)[: int(rng.integers(1, 3))]:
                    end(worker)
            process.send_signal(signal.SIGINT)
            shown, errors = process.communicate()
            assert process.returncode == 130, shown + errors
            assert "continue with `inkloop sweep" in shown
    with begun(*words, "--resume") as process:
        shown, errors = process.communicate()
        assert process.returncode in (0, 3), shown + errors


@pytest.mark.long
@pytest.mark.parametrize("workers", [1, 2])
def test_200_cylinders_killed_at_random_moments_are_those_of_a_study_left_alone(workers: int, tmp_path: Path) -> None:
    """Five settings with 40 seeds each; layers are kept, so that prints continue where they were killed."""
    path, out = tmp_path / "cylinders.toml", tmp_path / "out"
    path.write_text(f"{CYLINDERS}layers = true\n")
    words = [str(path), "--out", str(out), "--workers", str(workers)]
    kill_and_resume(words, out, 270, np.random.default_rng(workers), workers_of)
    expected, found = cylinders(), netcdf.read(out / "sweep.nc")
    assert (expected["status"] == 1).all()
    assert_same(found.assign_attrs(study=expected.attrs["study"]), expected)


@pytest.mark.long
@pytest.mark.parametrize("workers", [1, 2, 4])
@pytest.mark.parametrize("keep", ["layers = true", 'maps = "none"'])
def test_any_number_of_workers_gives_the_same_file(workers: int, keep: str, tmp_path: Path) -> None:
    path = study_file(tmp_path, seeds=3, keep=keep)
    study = Study.load(path)
    runs = str(tmp_path / "out" / "prints") if "layers" in keep else None
    order = Order(study.scenario.text, study.scenario.source, runs, False)
    with on_processes(workers, order) as site:
        found = printed(path, tmp_path / "out", site)
    assert_same(found, undisturbed(path, tmp_path / "undisturbed"))


def cylinders() -> xr.Dataset:
    """The study of 200 cylinders left alone, printed once for all tests."""
    return netcdf.read(once(_print_cylinders) / "out" / dataset.SWEEP_FILE)


def _print_cylinders(folder: Path) -> None:
    (folder / "cylinders.toml").write_text(CYLINDERS)
    undisturbed(folder / "cylinders.toml", folder / "out")


def test_worker_of_a_cluster_prints_each_of_two_studies_by_its_own_files(tmp_path: Path) -> None:
    """Their prints come in turns, and their classes have the same name."""
    distributed = pytest.importorskip("distributed", reason="inkloop[dask] is not installed; .ci/run has it")
    options = {"n_workers": 1, "threads_per_worker": 1, "processes": False, "dashboard_address": None}
    with distributed.LocalCluster(**options) as cluster, ExitStack() as stack:
        sites = {}
        for layers in (1, 2):
            source = tmp_path / str(layers) / "case.toml"
            source.parent.mkdir()
            source.write_text(OWN_RULE)
            source.with_name("own.py").write_text(RULE.format(layers=layers))
            order, bundle = Order(OWN_RULE, str(source), None, False), Bundle.of(OWN_RULE, source)
            sites[layers] = stack.enter_context(on_cluster(cluster.scheduler_address, order, bundle))
        for seed in (1, 2):
            task = Task(0, seed, seed, {})
            sent = {layers: site.executor.submit(site.work, task) for layers, site in sites.items()}
            for layers, future in sent.items():
                assert (future.result().error, future.result().metrics.get("layers")) == ("", layers)


@pytest.fixture
def dask_workers(tmp_path: Path) -> Iterator[tuple[str, Callable[[Any], list[int]]]]:
    """Address of a cluster of two workers that share no folder with this process, and what gives their processes."""
    distributed = pytest.importorskip("distributed", reason="inkloop[dask] is not installed")
    dask = pytest.importorskip("dask")
    folder = tmp_path / "workers"
    options = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "local_directory": str(folder)}
    with (  # on a busy machine a worker takes longer to come back than the 15 s after which a cluster forgets it
        dask.config.set({"distributed.deploy.lost-worker-timeout": "10 minutes"}),
        distributed.LocalCluster(**options, dashboard_address=None, silence_logs=50) as cluster,
    ):
        yield cluster.scheduler_address, lambda _: _registered(cluster)


def _registered(cluster: Any) -> list[int]:
    """Processes of the workers at work: a nanny whose worker is killed while it starts does not start another one."""
    at_work = {each.nanny for each in cluster.scheduler.workers.values()}
    nannies = [each for each in cluster.workers.values() if each.address in at_work and each.status.name == "running"]
    return [each.process.pid for each in nannies if each.process and each.process.status.name == "running"]


@pytest.mark.long
def test_200_cylinders_on_a_cluster_killed_at_random_moments_are_those_of_a_study_left_alone(
    dask_workers: tuple[str, Callable[[Any], list[int]]], tmp_path: Path
) -> None:
    address, processes = dask_workers
    path, out = tmp_path / "cylinders.toml", tmp_path / "out"
    path.write_text(CYLINDERS)
    words = [str(path), "--out", str(out), "--scheduler", address]
    kill_and_resume(words, out, 17, np.random.default_rng(3), processes)
    assert_same(netcdf.read(out / "sweep.nc"), cylinders())
    assert list((tmp_path / "workers").rglob("cylinder.toml"))  # what the workers were sent
