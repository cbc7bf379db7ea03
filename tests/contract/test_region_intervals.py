"""Regions of ink A with many intervals of height on a cell: every controller plans them alike, in every form."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
import xarray as xr
from tools import parts

from inkloop.component import Ink, Job
from inkloop.components import catalog
from inkloop.components.job_parameters import region_maps
from inkloop.errors import FmuError, ScenarioError
from inkloop.exchange import layer_job
from inkloop.exchange.layer_job import bake
from inkloop.fmu import describe
from inkloop.fmu_writer.archive import read_definition
from inkloop.fmu_writer.export import INTERVALS, INTERVALS_MAX, export_fmu, find_fmu
from inkloop.geometry import Columns, Cuboid, PipeJunction, cell_centers
from inkloop.printing.run import print_part
from inkloop.scenario.file import Scenario
from support.closed_loop import block
from support.fmus.fmu_driver import ERROR, FORMS, OK, Driver
from support.ink_choices import ink_choices
from support.sheets import Sheets

TWO_INKS = (Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6))
PIPES = PipeJunction(1e-3, 1e-3, 7e-4, 30e-6, 4e-4, 16e-6, 60e-6)
FIVE = Sheets([k * 10e-6 for k in (3, 0, 4, 1, 2)], thickness=6e-6, rise=2e-3, height=50e-6)
"""Five intervals on every cell."""
SCENARIO = """
title = "five sheets"
seed = 4
[grid]
nx = 9
ny = 8
[part]
shape = "mesh"
file = "sheets.stl"
unit = "mm"
place = "as-is"
[support]
margin_cells = 2
[components.controller]
kind = "LayerMpc"
horizon = 2
annealing_sweeps = 0
[components.printer]
kind = "LayerDeposition"
variation = 0.2
[components.profiler]
kind = "ProfileSensor"
noise_std_um = 0.1
scan_duration_s = 0.0
"""


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file whose part is the mesh of five sheets over 5 x 4 cells, which rise along x."""
    path = tmp_path_factory.mktemp("sheets") / "sheets.toml"
    path.write_text(SCENARIO)
    x, y = ((low * 0.263256, high * 0.263256) for low, high in ((1.5, 6.5), (1.5, 5.5)))
    sheets = np.concatenate([parts.box(x, y, at * 1e3, (at + FIVE.thickness) * 1e3) for at in FIVE.bottoms])
    sheets[..., 2] += FIVE.rise * sheets[..., 0]
    path.with_name("sheets.stl").write_bytes(parts.stl(sheets))
    return path


def printed(path: Path, **controller: Any) -> xr.Dataset:
    return print_part(Scenario.load(path, {"components.controller": controller} if controller else {})).dataset


def test_five_intervals_are_printed_alike_by_every_controller(scenario: Path, tmp_path: Path) -> None:
    run = printed(scenario)
    assert run.sizes["layer"] > 5
    for form in ("fmi3", "fmi2"):
        native = printed(scenario, kind="LayerController", fmi=form)
        for name in ("pattern", "height", "mismatch"):
            np.testing.assert_array_equal(native[name], run[name], err_msg=f"{name} by {form}")
    for form, fmi in (("fmi3-fixed", "3"), ("fmi2", "2")):
        layer_job.write(bake(Scenario.load(scenario)), fmi, tmp_path / f"{form}.fmu", picture=False)  # type: ignore[arg-type]
        fmpy.extract(str(tmp_path / f"{form}.fmu"), str(tmp_path / form))
        with Driver("LayerJob", form, folder=tmp_path / form) as fmu:
            assert fmu.start().get("region_intervals") == 5
            for layer in range(1, run.sizes["layer"]):
                assert fmu.step(layer - 1.0) == OK
                assert run.height.values[layer].tobytes() in fmu.save(), f"layer {layer} by {form}"


def test_mismatch_of_five_intervals_is_what_a_voxel_by_voxel_count_gives(scenario: Path) -> None:
    run, job = printed(scenario), Scenario.load(scenario).job()
    x, _ = cell_centers(job.nx, job.ny, job.pitch)
    wrong = wanted = 0
    for i, j in np.argwhere(job.mask):
        for k in range(int(np.ceil(max(run.height.values[-1].max(), job.target_height.max()) / 1e-6))):
            z = (k + 0.5) * 1e-6
            is_over = 2 <= i <= 6 and 2 <= j <= 5
            belongs = is_over and any(0.0 <= z - at - 2e-3 * x[i, j] <= 6e-6 for at in np.arange(5) * 10e-6)
            heights = run.height.values[:, i, j]
            layers = [n for n in range(1, heights.size) if heights[n - 1] <= z < heights[n]]
            is_a = bool(layers) and ink_of(run.pattern.values[layers[0]], i, j) == 1
            wrong, wanted = wrong + (is_a != belongs), wanted + belongs
    assert float(run.mismatch) == pytest.approx(wrong / wanted, rel=1e-12, abs=0.0)
    assert 0.0 < float(run.mismatch) < 0.7


def ink_of(pattern: Any, i: int, j: int) -> int:
    """The ink that brings most to a cell of a flat surface."""
    if pattern[i, j]:
        return int(pattern[i, j])
    shares = [0.0, 0.0]
    for a in (i - 1, i, i + 1):
        for b in (j - 1, j, j + 1):
            if 0 <= a < pattern.shape[0] and 0 <= b < pattern.shape[1] and pattern[a, b]:
                ink = Ink()
                shares[pattern[a, b] - 1] += ink.h2 if a == i or b == j else ink.h3
    return 1 + int(np.argmax(shares))


@pytest.mark.parametrize("region", [PIPES, Cuboid(9e-4, 9e-4, 1e-3, 1e-3, 20e-6), FIVE])
def test_maps_of_a_region_hold_the_heights_that_it_contains(region: Any) -> None:
    columns = Columns.of_shape(region, 20, 20, 1e-4)
    maps, generator = region_maps(columns, 6), np.random.default_rng(0)
    bottom, top = maps["region_bottom"], maps["region_top"]
    x, y = cell_centers(20, 20, 1e-4)
    for z in [*generator.uniform(-10e-6, 90e-6, (50, 20, 20)), *bottom, *top]:
        for asked in (z, np.nextafter(z, 1.0), np.nextafter(z, -1.0)):
            near = np.abs(asked) < 0.5
            inside = ((bottom <= asked) & (asked <= top)).any(axis=0)
            np.testing.assert_array_equal(inside[near], region.contains(x, y, asked)[near])


@pytest.mark.parametrize("test", ["middle", "surface", "either"])
def test_inks_of_a_surface_are_those_of_the_region_there(test: Any) -> None:
    """On random heights, on the edges of the intervals, and a hair beside them."""
    job = Job(20, 20, 1e-4, np.full((20, 20), 60e-6), np.ones((20, 20), np.bool_), TWO_INKS, FIVE)
    step = sum(ink.h1 + 4.0 * ink.h2 + 4.0 * ink.h3 for ink in TWO_INKS) / 2
    x, y = cell_centers(20, 20, 1e-4)
    edges = [end for pair in FIVE.intervals(x, y) for end in pair]
    shift = step / 2.0 if test == "middle" else 0.0
    for edge in (*np.random.default_rng(1).uniform(-5e-6, 70e-6, (20, 20, 20)), *(edge - shift for edge in edges)):
        for height in (edge, np.nextafter(edge, 1.0), np.nextafter(edge, -1.0)):
            for ahead, found in enumerate(ink_choices(job, test, height, 3)):
                low = height + ahead * step
                if test == "either":
                    here, above = FIVE.contains(x, y, low), FIVE.contains(x, y, low + step)
                    expected = np.where(here & above, 1, np.where(here | above, 3, 2))
                else:
                    expected = np.where(FIVE.contains(x, y, low + (step / 2.0 if test == "middle" else 0.0)), 1, 2)
                np.testing.assert_array_equal(found, expected)


def test_intervals_of_the_fmu_may_overlap_and_come_in_any_order() -> None:
    """Four maps that overlap, one within another, are the one interval that they cover; a map without one is none."""
    chosen = {"inks": 2, "has_region": True, "layers_scanned": 0, "measured_height": 6e-6, "horizon": 1}
    ends = {"region_bottom": [8e-6, 1.0, 2e-6, 5e-6, 8.5e-6], "region_top": [20e-6, -1.0, 6e-6, 9e-6, 9e-6]}
    patterns = []
    for intervals in (5, 1):
        with Driver("LayerController") as fmu:
            assert fmu.resize(9, 9, intervals) == OK
            whole = ends if intervals == 5 else {"region_bottom": [2e-6], "region_top": [20e-6]}
            maps = {name: np.reshape(values, (intervals, 1, 1)) for name, values in whole.items()}
            assert fmu.start(chosen | maps).step(0.0) == OK
            patterns.append(fmu.get("pattern"))
    np.testing.assert_array_equal(*patterns)
    assert (patterns[0] == 1).any()


def test_interval_without_length_is_one_height_of_the_region() -> None:
    """Both ends of an interval belong to the region: a surface of that very height gets ink A, one above it ink B."""
    on_the_surface = {"inks": 2, "has_region": True, "region_test": 2, "layers_scanned": 0, "horizon": 1}
    found = []
    for height in (6e-6, np.nextafter(6e-6, 1.0)):
        with Driver("LayerController", nx=9, ny=8) as fmu:
            ends = {"region_bottom": 6e-6, "region_top": 6e-6, "measured_height": height}
            assert fmu.start(on_the_surface | ends).step(0.0) == OK
            found.append(set(np.unique(fmu.get("pattern"))) - {0})
    assert found == [{1}, {2}]


@pytest.mark.parametrize("form", FORMS)
def test_fmu_without_a_region_has_room_for_two_intervals(form: str) -> None:
    with Driver("LayerController", form) as fmu:
        assert fmu.get("region_intervals") == 2
        assert fmu.get("region_bottom").shape == (2, 9, 9)
        assert (fmu.get("region_bottom") > fmu.get("region_top")).all()
        edges = np.zeros((2, 9, 9))
        edges[1, 2, 3] = np.nan
        assert fmu.set("region_bottom", edges) != OK
        assert "region_bottom of cell (2, 3) in map 2 is nan" in fmu.messages[-1]


def test_number_of_intervals_is_that_of_the_state_and_within_its_limits() -> None:
    known = {v.name: v for v in read_definition(find_fmu("LayerController")).variables}
    assert known[INTERVALS].max == INTERVALS_MAX
    with Driver("LayerController") as two, Driver("LayerController") as other:
        for count in (0, INTERVALS_MAX + 1, 2**40):
            other.messages.clear()
            assert other.resize(9, 9, count) != OK
            assert "region_intervals" in other.messages[0]
            assert other.call("reset") == OK
        assert other.resize(9, 9, 3) == OK
        assert other.start().restore(two.start().save()) == ERROR
        assert "the state has region_intervals 2; this instance has 3" in other.messages[-1]


@pytest.mark.parametrize("fmi", ["2", "3"])
def test_fixed_fmu_takes_as_many_intervals_as_it_was_exported_with(fmi: Any, tmp_path: Path) -> None:
    job, file = block(inks=TWO_INKS, region=FIVE), tmp_path / "controller.fmu"

    def made(intervals: int | None) -> Any:
        export_fmu("LayerController", nx=10, ny=9, fmi=fmi, fixed=True, intervals=intervals, out=file)
        return catalog.make("Fmu", job, {"file": str(file)})

    with pytest.raises(
        ScenarioError, match=r"has 5 intervals .*, this FMU has room for 2 .* --intervals 5 writes one that has"
    ):
        made(None)
    assert describe(file).variables["region_top"].shape({}) == (2, 10, 9)
    assert made(6).description.variables["region_top"].shape({}) == (6, 10, 9)


def test_resizable_fmu_gets_as_many_intervals_as_the_region_has() -> None:
    job = block(inks=TWO_INKS, region=FIVE)
    asked = {"region_intervals": 4}
    with pytest.raises(ScenarioError, match=r"has 5 intervals .* room for 4 .*; leave region_intervals out"):
        catalog.make("LayerController", job, asked)
    with pytest.raises(ScenarioError, match="region_intervals is 65; expected 1 to 64"):
        catalog.make("LayerController", job, {"region_intervals": 65})
    many = block(inks=TWO_INKS, region=Sheets([k * 1e-6 for k in range(65)], 0.5e-6))
    with pytest.raises(ScenarioError, match=r"has 65 intervals .*, this FMU has room for 64 .*; take 'LayerMpc'"):
        catalog.make("LayerController", many, {})


@pytest.mark.parametrize(
    ("model", "intervals", "message"),
    [
        ("LayerController", 65, "expected 1 to 64"),
        ("LayerController", 0, "are 0; expected 1 to 64"),
        ("ProfileSensor", 3, "no region"),
    ],
)
def test_export_refuses_a_number_of_intervals_that_no_fmu_has(
    model: str, intervals: int, message: str, tmp_path: Path
) -> None:
    with pytest.raises(FmuError, match=message):
        export_fmu(model, intervals=intervals, out=tmp_path / "no.fmu")
    for most in (1, INTERVALS_MAX):
        path = export_fmu("LayerController", nx=2, ny=1, intervals=most, fixed=True, out=tmp_path / "it.fmu")
        assert describe(path).variables["region_top"].shape({}) == (most, 2, 1)
