"""Files of labelled arrays are the NetCDF-4 files that xarray reads and writes through h5netcdf."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np
import pytest
import xarray as xr

from inkloop.results import netcdf


@pytest.fixture
def run() -> xr.Dataset:
    """Maps and rows of every type that ports have, a scalar, a layer that was not measured."""
    shape, rng = (3, 5, 4), np.random.default_rng(0)
    height = rng.normal(size=shape)
    height[1] = np.nan
    rows = ("layer",)
    return xr.Dataset(
        {
            "height": (("layer", "x", "y"), height, {"units": "m", "long_name": "surface, in µm too"}),
            "single": (("layer", "x", "y"), height.astype(np.float32)),
            "valid": (("layer", "x", "y"), rng.random(shape) < 0.5, {"units": "1"}),
            "pattern": (("layer", "x", "y"), rng.integers(-2, 3, shape, np.int32)),
            "ink": (("layer", "x", "y"), rng.integers(0, 3, shape, np.int8)),
            "is_done": (rows, np.array([False, False, True])),
            "time": (rows, np.array([0.0, np.nan, 2.5]), {"units": "s"}),
            "mask": (("x", "y"), rng.random(shape[1:]) < 0.8),
            "mismatch": ((), 0.25, {"units": "1"}),
        },
        {"layer": np.arange(3), "x": ("x", np.arange(5) * 1e-4, {"units": "m"}), "y": np.arange(4) * 1e-4},
        {"title": "Block", "schema_version": 1, "pitch": 1e-4, "scenario": "title = 'Block'  # µm\n" * 5000},
    )


def assert_same(one: xr.Dataset, other: xr.Dataset) -> None:
    xr.testing.assert_identical(one, other)
    assert {name: array.dtype for name, array in one.variables.items()} == {
        name: array.dtype for name, array in other.variables.items()
    }


def test_file_reads_back_the_same_here_and_in_xarray_and_one_of_xarray_here(run: xr.Dataset, tmp_path: Path) -> None:
    path = tmp_path / "result.nc"
    path.write_bytes(netcdf.packed(run))
    assert_same(netcdf.read(path), run)
    assert_same(xr.load_dataset(path, engine="h5netcdf"), run)
    run.to_netcdf(tmp_path / "other.nc", engine="h5netcdf")
    assert_same(netcdf.read(tmp_path / "other.nc"), run)
    with pytest.raises(KeyError):  # a dimension without coordinates
        netcdf.packed(xr.Dataset({"height": (("x",), np.zeros(3))}))


def test_file_has_dimensions_and_fill_values_of_netcdf_and_packed_maps(run: xr.Dataset, tmp_path: Path) -> None:
    path = tmp_path / "result.nc"
    path.write_bytes(netcdf.packed(run))
    with h5netcdf.File(path) as file:
        assert {name: len(dimension) for name, dimension in file.dimensions.items()} == dict(run.sizes)
        assert file["height"].dimensions == ("layer", "x", "y")
        assert file["height"].compression == "gzip"
        assert np.isnan(file["height"].attrs["_FillValue"]).all()
        assert file["time"].compression is None
        assert "_FillValue" not in file["x"].attrs


@pytest.mark.parametrize(
    "parts",
    [[(0, 2), (2, 4), (4, 5)], [(layer, layer + 1) for layer in range(5)], [(0, 3), (1, 5)], [(2, 4), (0, 5)]],
    ids=["whole chunks", "parts of chunks", "both", "again"],
)
@pytest.mark.parametrize("dtype", [np.float64, np.int32, np.bool_])
def test_maps_that_are_compressed_here_are_read_by_others(
    parts: list[tuple[int, int]], dtype: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In chunks of two layers, three rows and four columns, that do not fill the maps."""
    monkeypatch.setattr(netcdf, "_chunks", lambda shape: (2, 3, 4))
    values = np.random.default_rng(1).normal(size=(5, 8, 10)).round().astype(dtype)
    path, dimensions = tmp_path / "result.nc", ("layer", "x", "y")
    with netcdf.created(path) as (file, _):
        coordinates = {name: np.arange(count) for name, count in zip(dimensions, values.shape, strict=True)}
        netcdf.store(file, xr.Dataset(coords=coordinates))
        stored = netcdf.add(file, "map", dimensions, values.shape, values.dtype, {})
        for first, after in parts:
            netcdf.fill(stored, first, values[first:after])
    with xr.open_dataset(path, engine="h5netcdf") as found:
        assert found["map"].dtype == dtype
        np.testing.assert_array_equal(found["map"], values)


def test_chunk_holds_tiles_of_a_layer_or_layers_of_a_small_map() -> None:
    assert netcdf._chunks((40, 12, 12)) == (40, 12, 12)
    assert netcdf._chunks((3, 1000, 700)) == (1, 256, 256)
    assert netcdf._chunks((5, 3, 1000, 700)) == (1, 1, 256, 256)
    assert netcdf._chunks((12, 8)) == (12, 8)
