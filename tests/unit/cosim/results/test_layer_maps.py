"""Maps by layer: the same in memory and in a file, one at a time; a state that cannot be saved costs no earlier one."""

from __future__ import annotations

import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from inkloop.component import Ink, Job
from inkloop.printing import print as print_module
from inkloop.printing.print import Print
from inkloop.results import layer_maps, netcdf, result, solid
from inkloop.results.array_file import StoredArray
from inkloop.results.layer_maps import LayerMaps
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from support.half_spaces import Below
from support.places import ROOT

LAYERS, SIDE = 40, 300
TABLE = xr.Dataset(coords={"layer": np.arange(LAYERS), "x": np.arange(SIDE), "y": np.arange(SIDE)})


def random_maps(layers: int, seed: int = 3) -> Any:
    """One map a layer, with noise that no compression takes away, made when it is asked for."""
    numbers = np.random.default_rng(seed)
    return (("height", layer, numbers.random((SIDE, SIDE))) for layer in range(layers))


@pytest.mark.system
def test_file_takes_the_memory_of_few_maps(tmp_path: Path) -> None:
    variables = {"height": (np.dtype(np.float64), {"units": "m"})}
    LayerMaps((LAYERS, SIDE, SIDE), variables, random_maps(2)).write(tmp_path / "first.nc", TABLE)  # imports
    tracemalloc.start()
    LayerMaps((LAYERS, SIDE, SIDE), variables, random_maps(LAYERS)).write(tmp_path / "result.nc", TABLE)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 6 * 8 * SIDE * SIDE
    assert np.isnan(netcdf.read(tmp_path / "first.nc").height[2:]).all()
    with xr.open_dataset(tmp_path / "result.nc", engine="h5netcdf") as stored:
        for _, layer, expected in random_maps(LAYERS):
            np.testing.assert_array_equal(stored.height[layer], expected)


def test_maps_on_disk_take_the_memory_of_what_is_used(tmp_path: Path) -> None:
    """And no open file: a system lets a process have a thousand or fewer."""
    resource = pytest.importorskip("resource")
    for _, layer, map_ in random_maps(LAYERS):
        np.savez(tmp_path / f"{layer}.npz", **{"height": map_})
    variables: Any = {"height": (np.dtype(np.float64), {"units": "m"}), "none": (np.dtype(np.int32), {})}
    rows = [("height", layer, StoredArray(tmp_path / f"{layer}.npz", "height")) for layer in range(LAYERS)]
    maps = LayerMaps((LAYERS, SIDE, SIDE), variables, rows)
    with rows[0][2].path.open() as file:
        first_free = file.fileno()
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (first_free + LAYERS // 2, hard))
    tracemalloc.start()
    try:
        run = maps.laid_over(TABLE)
        last = run.height[-1].values
        means = [float(run.height[layer].mean()) for layer in range(LAYERS)]
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    assert peak < 4 * 8 * SIDE * SIDE
    assert np.allclose(means, 0.5, rtol=0.0, atol=0.01)
    *_, (_, _, expected) = random_maps(LAYERS)
    np.testing.assert_array_equal(last, expected)
    xr.testing.assert_identical(run.load(), maps.added_to(TABLE))


def test_maps_of_layers_that_were_not_printed_are_left_out_and_of_others_the_last_one_counts(tmp_path: Path) -> None:
    variables: Any = {"height": (np.dtype(np.float64), {"units": "m"})}
    rows = [("height", layer, np.full((3, 5), value)) for layer, value in ((0, 1.0), (1, 2.0), (2, 9.0), (1, 3.0))]
    table = xr.Dataset(coords={"layer": np.arange(2), "x": np.arange(3), "y": np.arange(5)})
    maps = LayerMaps((2, 3, 5), variables, rows)
    maps.write(tmp_path / "result.nc", table)
    for found in (maps.added_to(table), maps.laid_over(table), netcdf.read(tmp_path / "result.nc")):
        assert found.height[:, 2, 4].values.tolist() == [1.0, 3.0]
    assert maps.nbytes == 2 * 3 * 5 * 8


def test_only_heights_of_large_grids_are_rounded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 3 x 5 cells; a length of no integer type, in metres."""
    monkeypatch.setattr(layer_maps, "ROUNDED_CELLS", 14)
    names = {"height": ("f8", "m"), "share": ("f8", "1"), "count": ("i4", "m")}
    variables: Any = {name: (np.dtype(dtype), {"units": unit}) for name, (dtype, unit) in names.items()}
    table = xr.Dataset(coords={"layer": [0], "x": np.arange(3), "y": np.arange(5)})
    rows = [(name, 0, np.full((3, 5), 1.3 * layer_maps.ROUNDED_M)) for name in ("height", "share")]
    found = LayerMaps((1, 3, 5), variables, rows).added_to(table)
    assert found.height[0, 0, 0] == layer_maps.ROUNDED_M
    assert found.share[0, 0, 0] == 1.3 * layer_maps.ROUNDED_M
    assert [name for name in names if "rounded_to" in found[name].attrs] == ["height"]
    monkeypatch.setattr(layer_maps, "ROUNDED_CELLS", 15)
    assert LayerMaps((1, 3, 5), variables, rows).added_to(table).height[0, 0, 0] == 1.3 * layer_maps.ROUNDED_M


@pytest.mark.parametrize("name", ["cuboid", "two-materials"])
def test_maps_of_a_large_result_are_read_when_they_are_used(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The result of a run is that in its folder, rounded too, whether it is kept in memory or read back."""
    monkeypatch.setattr(layer_maps, "ROUNDED_CELLS", 100)
    evaluated = {"parameters": ["Sq", "Sz"], "every_layer": True}
    changed = {"run.layers_max": 2, "components.controller.horizon": 1, "metrology": evaluated}
    scenario = Scenario.load(ROOT / "scenarios" / f"{name}.toml", changed)
    small = Print(scenario, tmp_path / "small").run()
    assert small.dataset.height.variable._in_memory
    assert ("Sq" in small.dataset, small.dataset.height.attrs["rounded_to"]) == (True, layer_maps.ROUNDED_M)
    xr.testing.assert_identical(small.dataset, Result.load(tmp_path / "small").dataset)
    monkeypatch.setattr(result, "READ_AT_ONCE", 1000)
    monkeypatch.setattr(print_module, "READ_AT_ONCE", 1000)
    large = Print(scenario, tmp_path / "large").run()
    assert not large.dataset.height.variable._in_memory
    assert large.metrics() == small.metrics()
    xr.testing.assert_identical(large.dataset.drop_vars("solve_time"), small.dataset.drop_vars("solve_time"))


@pytest.mark.parametrize("name", ["cuboid", "two-materials"])
def test_maps_that_a_run_hands_over_and_those_in_memory_give_the_same_result(name: str, tmp_path: Path) -> None:
    """The print in memory has all maps at once; a file keeps the regions of ink, too."""
    changed = {"run.layers_max": 2, "components.controller.horizon": 1}
    scenario = Scenario.load(ROOT / "scenarios" / f"{name}.toml", changed)
    written, kept = Print(scenario, tmp_path).run().dataset, Print(scenario).run().dataset
    assert set(written) == set(kept)
    xr.testing.assert_identical(written.drop_vars("solve_time"), kept.drop_vars("solve_time"))


def test_mismatch_read_in_parts_is_that_of_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    numbers = np.random.default_rng(5)
    height = np.cumsum(numbers.uniform(0.0, 9e-6, (6, 7, 5)), axis=0)
    ink = numbers.integers(0, 3, height.shape).astype(np.int8)
    job = Job(7, 5, 1e-4, height[-1], numbers.random((7, 5)) < 0.8, (Ink(), Ink()), Below(13e-6))
    whole = solid.mismatch(height, ink, job)
    monkeypatch.setattr(solid, "_BYTES_AT_ONCE", 1)
    assert solid.mismatch(height, ink, job) == whole > 0.0
