"""A print that memory or disk cannot hold is refused with an estimate before anything of its size is made."""

from __future__ import annotations

import json
import math
import re
import shutil
import subprocess
import sys
import tracemalloc
from pathlib import Path
from typing import Any, Literal

import pytest

import inkloop
from inkloop.bench.commands import emulation_of
from inkloop.cli import main
from inkloop.errors import FmuError, ResultError, ScenarioError
from inkloop.limits import GIB, KIB, MIB
from inkloop.printing.print import Print
from inkloop.printing.run import checked_run_folder
from inkloop.results import array_file, checkpoint
from inkloop.results.layer_maps import LayerMaps
from inkloop.scenario import footprint
from inkloop.scenario.file import Scenario
from inkloop.scenario.footprint import Footprint
from inkloop_controller.planning.horizon_planner import ending_of
from support.places import ROOT

CUBOID = ROOT / "scenarios" / "cuboid.toml"
SMALL_CELLS = {"grid.nx": 12, "grid.ny": 12, "part.size_x_um": 500.0, "part.size_y_um": 500.0}


@pytest.fixture
def eight_gib(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("inkloop.limits.available_memory", lambda: 8 * GIB)
    monkeypatch.setattr("inkloop.scenario.footprint.available_memory", lambda: 8 * GIB)


@pytest.mark.parametrize("side", [100_000])
@pytest.mark.parametrize("command", ["validate", "run", "bench emulate", "export ssp", "export job"])
def test_grid_that_memory_cannot_hold_is_refused_by_every_command(
    command: str, side: int, eight_gib: None, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    grid = ["--set", f"grid.nx={side}", "--set", f"grid.ny={side}"]
    out = ["--out", str(tmp_path / "out")] if command not in ("validate", "bench emulate") else []
    assert main([*command.split(), str(CUBOID), *grid, *out]) == 1
    error = capsys.readouterr().err
    assert f"grid of {side} x {side} cells, about 9 layers, needs about" in error
    assert "of memory, 8 GiB are available; " in error
    assert " cells would fit: choose a smaller grid or a larger pitch" in error
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("nx", "ny", "share", "advice"),
    [(40, 90, 0.25, "20 x 45"), (2, 1_000_000, 0.09, "2 x 90000"), (3_000_000, 1, 1e-4, "300 x 1")],
)
def test_grid_that_would_fit_has_both_sides(
    nx: int, ny: int, share: float, advice: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the same shape; of a side that is far too long only that one is cut."""
    planned = Footprint(nx, ny, 3, 3.0, 100, 10**12, 1.0)
    monkeypatch.setattr("inkloop.scenario.footprint.free_disk", lambda _: math.ceil(share * planned.disk))
    with pytest.raises(ResultError, match=rf"; {advice} cells would fit: "):
        planned.check_disk(tmp_path)


@pytest.mark.parametrize("free", [0, 900_000, 1_000_000 + 63 * 100])
def test_no_grid_is_advised_where_hardly_a_cell_fits_beside_the_files(
    free: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    planned = Footprint(12, 12, 9, 3.0, 100, 100, 1.0, 1_000_000)
    monkeypatch.setattr("inkloop.scenario.footprint.free_disk", lambda _: free)
    with pytest.raises(ResultError, match=r"needs about 991 KiB of disk, .*; there is no room for a smaller grid eith"):
        planned.check_disk(tmp_path)
    monkeypatch.setattr("inkloop.limits.available_memory", lambda: 0)
    monkeypatch.setattr("inkloop.scenario.footprint.available_memory", lambda: 0)
    (error,) = planned.memory_errors()
    assert error.endswith("0 KiB are available; there is no room for a smaller grid either: make room, or free memory")


def test_disk_that_is_just_enough_is_enough(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    planned = Footprint(40, 90, 3, 3.0, 100, 10**12, 1.0)
    monkeypatch.setattr("inkloop.scenario.footprint.free_disk", lambda _: planned.disk)
    planned.check_disk(tmp_path)
    monkeypatch.setattr("inkloop.scenario.footprint.free_disk", lambda _: planned.disk - 1)
    with pytest.raises(ResultError, match="40 x 90 cells"):
        planned.check_disk(tmp_path)


@pytest.mark.parametrize("name", ["bracket", "lithophane"])
def test_grid_is_refused_before_a_part_is_laid_over_it(name: str, eight_gib: None) -> None:
    tracemalloc.start()
    with pytest.raises(ScenarioError, match="grid of 90000 x 90000 cells, about 1 layer, needs about"):
        inkloop.load(ROOT / "scenarios" / f"{name}.toml", {"grid.nx": 90_000, "grid.ny": 90_000})
    assert tracemalloc.get_traced_memory()[1] < 100 * MIB
    tracemalloc.stop()


def test_run_that_the_disk_cannot_hold_is_refused_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(footprint, "free_disk", lambda folder: 10 * KIB)
    scenario = Scenario.load(CUBOID)
    with pytest.raises(
        ResultError, match=r"new: grid of .* needs about .* of disk, 10 KiB are free there; there is no room"
    ):
        checked_run_folder(scenario, tmp_path / "new", "cuboid")
    with pytest.raises(ResultError, match="of disk, 10 KiB are free there"):
        inkloop.run(CUBOID, out=tmp_path / "new")
    assert main(["validate", str(CUBOID)]) == 1
    assert list(tmp_path.iterdir()) == []


def test_grid_that_the_nodes_of_a_bench_cannot_hold_is_refused() -> None:
    tables = Scenario.load(CUBOID)
    larger = tables.tables.grid.model_copy(update={"nx": 2000, "ny": 1000})
    object.__setattr__(tables.tables, "grid", larger)
    with pytest.raises(ScenarioError, match="grid of 2000 x 1000 cells: the nodes of the bench hold up to 1,000,000"):
        emulation_of(tables)


@pytest.mark.parametrize(
    ("fmi", "side", "advice"), [("2", 5000, "or FMI 3"), ("3", 10_000_000, "choose a smaller grid$")]
)
def test_fmu_that_no_importer_can_hold_is_not_exported(
    fmi: Literal["2", "3"], side: int, advice: str, eight_gib: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(FmuError, match=f"LayerDeposition as FMI {fmi} of {side} x {side} cells needs about .*{advice}"):
        inkloop.export_fmu("LayerDeposition", fmi=fmi, nx=side, ny=side, out=tmp_path / "large.fmu")
    assert list(tmp_path.iterdir()) == []


def test_computing_of_a_large_grid_is_what_large_prints_take() -> None:
    """36 million cells, ten layers, one ahead: 718 s of processor time were measured; small layers take more a cell."""
    large = Scenario.load(ROOT / "scenarios" / "large" / "36-million.toml", SMALL_CELLS)

    def seconds(side: int) -> float:
        grid = large.tables.grid.model_copy(update={"nx": side, "ny": side})
        tables = large.tables.model_copy(update={"grid": grid})
        return Footprint.of(tables, large.solid.shape.height, side**2).seconds

    assert seconds(6000) == pytest.approx(718.0, rel=0.25, abs=0.0)
    assert (seconds(100) - seconds(0)) / 100**2 > 3.0 * seconds(6000) / 6000**2


@pytest.mark.parametrize("finish", footprint.HORIZONS)
def test_layers_ahead_are_those_of_the_controller(finish: Literal["even", "fast"]) -> None:
    assert footprint.HORIZONS[finish] == ending_of(finish).horizon


def test_disk_is_what_a_print_takes_when_most_is_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The run folder while a file is replaced, and while the result is written, for each cell beyond a small grid.

    Of a state, which every layer has here, there are two while one is replaced.
    """
    monkeypatch.setattr(checkpoint, "STATE_SHARE", 1.0)
    peaks: dict[int, int] = {}

    def watched(write: Any) -> Any:
        def write_and_look(*arguments: Any, **options: Any) -> None:
            write(*arguments, **options)
            found = sum(path.stat().st_size for path in tmp_path.rglob("*") if path.is_file())
            peaks[side] = max(peaks.get(side, 0), found)

        return write_and_look

    monkeypatch.setattr(array_file, "write_arrays", watched(array_file.write_arrays))
    monkeypatch.setattr(LayerMaps, "write", watched(LayerMaps.write))
    for side in (20, 60):
        cells = {"grid.nx": side, "grid.ny": side}
        size = {f"part.size_{axis}_um": 263.256 * (side - 4) for axis in "xy"}
        kind = {"components.controller.horizon": 1, "run.layers_max": 3, "components.profiler.noise_std_um": 0.3}
        loaded = Scenario.load(CUBOID, cells | size | kind)
        Print(loaded, tmp_path / "run").run()
        shutil.rmtree(tmp_path / "run")
    of_a_cell = (peaks[60] - peaks[20]) / (60**2 - 20**2)
    alone = Footprint.of(loaded.tables.model_copy(update={"compare": {}}), loaded.solid.shape.height)
    assert of_a_cell == pytest.approx(alone.disk_of_a_cell, rel=0.25, abs=0.0)
    of_files = peaks[20] - of_a_cell * 20**2
    expected = footprint.BYTES_OF_A_LAYER_FILE * (3 + 1) + 2 * footprint.BYTES_OF_A_STATE_FILE
    assert of_files < expected < 1.5 * of_files


PRINTED = json.loads((ROOT / "docs" / "gallery" / "runs.json").read_text(encoding="utf-8"))
WORSE = {"wu-chiu-plant": 1.5, "two-materials": 2.0}


@pytest.mark.parametrize("name", [name for name in PRINTED if (ROOT / "scenarios" / f"{name}.toml").is_file()])
def test_layers_expected_are_those_printed(name: str) -> None:
    """The layers of the gallery, of closed loops too: within a quarter, but for a few named ones."""
    if name.endswith("3mf"):
        pytest.importorskip("lib3mf")
    loaded = Scenario.load(ROOT / "scenarios" / f"{name}.toml")
    ratio = loaded.footprint.layers / PRINTED[name]["runs"][loaded.tables.label]["layers"]
    assert max(ratio, 1.0 / ratio) <= WORSE.get(name, 1.25)


@pytest.mark.parametrize(
    ("options", "layers"),
    [
        # 400 µm over the 6.6 of an edge cell: 60.6 layers without variation, and five that make the top flat
        ({}, 66),
        ({"variation": 0.2}, 73),
        ({"variation": 0.2, "nozzle_variation": 0.2}, 80),
    ],
)
def test_droplets_that_lack_volume_need_more_layers(options: dict[str, float], layers: int) -> None:
    keys = {f"components.printer.{key}": value for key, value in ({"variation": 0.0} | options).items()}
    assert Scenario.load(CUBOID, {"part.height_um": 400.0} | keys).footprint.layers == layers


@pytest.mark.long
@pytest.mark.parametrize(
    ("controller", "options"),
    [("OpenLoop", {}), ("LayerMpc", {"horizon": 1}), ("LayerMpc", {"horizon": 3}), ("LayerController", {"horizon": 1})],
)
def test_memory_is_within_a_quarter_of_what_a_print_takes(controller: str, options: dict[str, int]) -> None:
    """Processes that print grids other than those from which the estimate was taken."""
    keys = {f"components.controller.{name}": value for name, value in ({"kind": controller} | options).items()}
    text = CUBOID.read_text().partition("[compare.")[0].replace("alpha = 0.8\n", "")
    estimate = Scenario.of_text(text, str(CUBOID), keys).footprint.memory_of_a_cell
    found = {}
    for side in (900, 1300):  # states of both are too large to be written after every layer
        code = f"from support.peak_memory import peak; print(peak({side}, {controller!r}, **{options}))"
        command, folder = [sys.executable, "-c", code], ROOT / "tests"
        found[side] = int(subprocess.run(command, check=True, capture_output=True, text=True, cwd=folder).stdout)
    of_a_cell = (found[1300] - found[900]) / (1300**2 - 900**2)
    assert of_a_cell == pytest.approx(estimate, rel=0.25, abs=0.0)


@pytest.mark.parametrize("path", sorted((ROOT / "scenarios" / "large").glob("*.toml")), ids=lambda path: path.stem)
def test_large_scenarios_are_valid_on_a_small_grid(path: Path) -> None:
    """As they are, they take too long for a test."""
    assert Scenario.load(path, SMALL_CELLS).footprint.layers == 10


HORIZON, MODEL = "components.controller.horizon", "components.printer.kind"


@pytest.mark.parametrize(
    ("overrides", "layers", "memory", "disk", "searched", "microseconds"),
    [
        # bytes of a cell: memory of 285, and for five layers ahead 60 + 4 * 28; disk of 34 of each layer and the start,
        # the state of 165, and twice that or 21 a layer of results, and those of the open loop; layers for which a plan
        # is searched; time of a printed cell: in each of them, and 5 in each layer of both runs
        ({}, 9, 457, 34 * 10 + 165 + 210 + 84, 9, 60),
        ({HORIZON: 1}, 5, 345, 34 * 6 + 165 + 165 + 84, 5, 10),
        ({HORIZON: 3}, 7, 401, 34 * 8 + 165 + 168 + 84, 7, 15),
        ({HORIZON: 4}, 8, 429, 34 * 9 + 165 + 189 + 84, 8, 35),
        ({"components.controller.finish": "fast"}, 8, 429, 34 * 9 + 165 + 189 + 84, 8, 35),
        ({"part.height_um": 53.4}, 14, 457, 34 * 15 + 165 + 21 * 15 + 21 * 9, 14, 60),
        ({"part.height_um": 53.5}, 15, 457, 34 * 16 + 165 + 21 * 16 + 21 * 9, 15, 60),
        ({"part.height_um": 594.0}, 105, 457, 34 * 106 + 165 + 21 * 106 + 21 * 80, 20, 60),
        ({"part.height_um": 760.0, "run.layers_max": 10}, 10, 457, 34 * 11 + 165 + 21 * 11 * 2, 10, 60),
        ({"part.height_um": 0.5}, 6, 457, 34 * 7 + 165 + 165 + 21 * 2, 6, 60),
        ({MODEL: "YoungLaplaceDeposition"}, 9, 6157, 34 * 10 + 705 + 705 + 84, 9, 60 + 12 * 75 / 9),
        ({"process.passes": 4}, 9, 457, 799, 9, 5 * 60),
        ({"components.controller.kind": "LayerController"}, 9, 562, 34 * 10 + 235 + 235 + 84, 9, 60),
    ],
)
def test_estimate_of_the_cuboid_is_that_of_its_parts(
    overrides: dict[str, Any], layers: int, memory: int, disk: int, searched: int, microseconds: float
) -> None:
    text = CUBOID.read_text(encoding="utf-8")
    if MODEL in overrides:
        text = text.replace("variation = 0.2\n", "").replace('variation_kind = "per_droplet"\n', "")
    tables = inkloop.Scenario.of_text(text, "cuboid.toml", overrides).tables
    found, large = (Footprint.of(tables, tables.part.height_um * 1e-6, cells) for cells in (64, 1001))
    assert (found.layers, found.memory_of_a_cell, found.disk_of_a_cell) == (layers, memory, disk)
    assert (found.memory, found.disk) == (144 * memory, 144 * disk + found.disk_of_files)
    height = overrides.get("part.height_um", 22.8)
    open_loop = min(math.ceil(height / 7.6 - 1e-6), 10 if "run.layers_max" in overrides else 1000)
    of_a_cell = ((layers + open_loop) * 4 + searched * microseconds) * 1e-6
    annealed = 0.0 if overrides.get(HORIZON) == 1 else searched * 0.08
    assert found.seconds == pytest.approx(2.8 + 2 * 0.5 + annealed + 64 * of_a_cell, rel=1e-9, abs=0.0)
    assert large.seconds == pytest.approx(2.8 + 2 * 0.5 + 1001 * of_a_cell, rel=1e-9, abs=0.0)


def test_results_of_large_grids_are_rounded_and_take_less_disk() -> None:
    tables = Scenario.load(CUBOID).tables

    def disk(nx: int) -> int:
        grid = tables.grid.model_copy(update={"nx": nx, "ny": 512})
        return Footprint.of(tables.model_copy(update={"grid": grid}), 22.8e-6).disk_of_a_cell

    assert (disk(512), disk(513)) == (340 + 165 + 210 + 84, 340 + 165 + 165 + 9 * 4)


@pytest.mark.parametrize(
    ("height", "layers_max", "message"),
    [
        (22.8, 1000, ""),
        (0.31 * 7.6, 1000, ""),
        (0.29 * 7.6, 1000, "the part is 0.29 of a layer high; a droplet is higher, and nothing may be printed; check"),
        (7.6 * 99, 10, ""),
        (7.6 * 101, 10, "the part is about 101 layers high; run.layers_max ends the print after 10; check the heights"),
    ],
)
def test_height_in_other_units_is_a_warning(height: float, layers_max: int, message: str) -> None:
    tables = inkloop.load(CUBOID, {"run.layers_max": layers_max}).tables
    warnings = list(Footprint.of(tables, height * 1e-6).warnings())
    assert len(warnings) == (message != "")
    assert all(message in warning for warning in warnings)


@pytest.mark.parametrize(
    ("ink", "message"),
    [
        ({"h1_um": 0.6}, ""),
        ({"h1_um": 0.0044}, "ink.a.h1_um is 0.0044, less than h2_um, 0.6: a droplet adds less to its own cell than to"),
        ({"h3_um": 4.5}, "ink.a.h1_um is 4.4, less than h3_um, 4.5: a droplet adds less to its own cell than to"),
        ({"h1_um": 440.0}, "nothing may be printed; check the heights of [part], and those of a droplet in [ink.a]"),
    ],
)
def test_ink_in_other_units_is_a_warning(ink: dict[str, float], message: str) -> None:
    warnings = Scenario.load(CUBOID, {f"ink.a.{key}": value for key, value in ink.items()}).warnings
    assert len(warnings) == (message != "")
    assert all(message in warning for warning in warnings)


def test_run_that_takes_most_memory_counts_and_linear_programs_take_their_time() -> None:
    def found(**keys: object) -> Footprint:
        return Scenario.load(CUBOID, {f"components.controller.{key}": value for key, value in keys.items()}).footprint

    compared = Scenario.load(CUBOID, {"compare.other.components.controller": {"kind": "LayerController"}}).footprint
    assert compared.memory_of_a_cell == found().memory_of_a_cell + 105
    slower = [found(horizon=n, relaxation="slp").seconds - found(horizon=n).seconds for n in (2, 3)]
    assert slower == pytest.approx([64 * 6 * 4600e-6, 64 * 7 * 6900e-6], rel=1e-9, abs=0.0)


def test_every_command_tells_the_same_time_of_a_print(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """That of the printed cells, with the runs that are compared."""
    told, print_ = [], ["run", "cuboid", "--no-pictures", "--no-compare", "--out", str(tmp_path / "run")]
    for command in (["validate", "cuboid"], ["geometry", "cuboid", "--no-pictures"], print_):
        assert main(command) == 0
        told += re.findall(r"about (4\.\d+) s(?: of computing)? on one core", capsys.readouterr().out)
    assert told == [f"{Scenario.load(CUBOID).footprint.seconds:.2g}"] * 3
