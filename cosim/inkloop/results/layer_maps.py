"""The maps of a print by layer: put together in memory, or written to a netCDF file one at a time.

A file takes a few maps of memory, whatever the number of layers.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inkloop.component import Job
from inkloop.limits import ROUNDED_CELLS
from inkloop.results import netcdf
from inkloop.results.attributes import variable
from inkloop.results.solid import INK, mismatch

if TYPE_CHECKING:
    import xarray as xr

DIMENSIONS = ("layer", "x", "y")
ROUNDED_M = 2.0**-40
"""Heights of maps with more than ROUNDED_CELLS are multiples of this, 0.9 pm: an error of 0.46 pm at most."""


@dataclass(frozen=True, eq=False)
class LayerMaps:
    """Maps (nx, ny) of a number of layers, each at most once in memory.

    variables: name -> NumPy dtype and attributes; rows: (name, layer, map) in the order of recording, where the last
    one of a layer counts. Layers without a map hold NaN or 0. job: of a part in two inks, whose `mismatch` is added.
    """

    shape: tuple[int, int, int]
    variables: Mapping[str, tuple[np.dtype[Any], Mapping[str, Any]]]
    rows: Iterable[tuple[str, int, ArrayLike]]
    job: Job | None = None

    @property
    def nbytes(self) -> int:
        """Bytes of all maps."""
        return prod(self.shape) * sum(dtype.itemsize for dtype, _ in self.variables.values())

    def added_to(self, table: xr.Dataset) -> xr.Dataset:
        """The dataset with these maps, in memory."""
        arrays = {
            name: np.full(self.shape, _unknown(dtype), dtype=dtype) for name, (dtype, _) in self.variables.items()
        }
        for name, layer, map_ in self._final_rows():
            arrays[name][layer] = map_
        maps = {name: (DIMENSIONS, values, self._attributes(name)) for name, values in arrays.items()}
        return table.assign({**maps, **self._derived(arrays)})

    def laid_over(self, table: xr.Dataset) -> xr.Dataset:
        """The dataset with these maps where they are: `StoredArray`s are read when they are used."""
        count, *size = self.shape
        layers: dict[str, list[ArrayLike]] = {
            name: [np.broadcast_to(dtype.type(_unknown(dtype)), size)] * count
            for name, (dtype, _) in self.variables.items()
        }
        for name, layer, map_ in self.rows:
            if layer < count:
                layers[name][layer] = map_
        maps = {
            name: _stacked(layers[name], self.shape, dtype, attributes)
            for name, (dtype, attributes) in self.variables.items()
        }
        return table.assign({**maps, **self._derived(maps)})

    def write(self, path: Path, table: xr.Dataset) -> None:
        """Write the dataset with these maps as netCDF. Raises OSError."""
        with netcdf.created(path) as (file, check):
            netcdf.store(file, table)
            arrays = {
                name: netcdf.add(file, name, DIMENSIONS, self.shape, np.dtype(dtype), self._attributes(name))
                for name, (dtype, _) in self.variables.items()
            }
            for name, layer, map_ in self._final_rows():
                netcdf.fill(arrays[name], layer, map_[np.newaxis])
                check()
            for name, scalar in self._derived(arrays).items():
                netcdf.put(file, name, scalar)

    def _final_rows(self) -> Iterator[tuple[str, int, NDArray[Any]]]:
        """The rows as they are kept: heights of large maps are rounded."""
        for name, layer, map_ in self.rows:
            if layer >= self.shape[0]:
                continue
            values = np.asarray(map_)
            if self._is_rounded(name):
                values = values / ROUNDED_M
                np.rint(values, out=values)
                values *= ROUNDED_M
            yield name, layer, values

    def _derived(self, arrays: Mapping[str, Any]) -> dict[str, xr.Variable]:
        """Variables that follow from all maps."""
        if self.job is None or self.job.region is None or INK not in arrays:
            return {}
        return {"mismatch": variable("mismatch", (), mismatch(arrays["height"], arrays[INK], self.job), "1")}

    def _is_rounded(self, name: str) -> bool:
        _, nx, ny = self.shape
        dtype, attributes = self.variables[name]
        return nx * ny > ROUNDED_CELLS and dtype.kind == "f" and attributes.get("units") == "m"

    def _attributes(self, name: str) -> dict[str, Any]:
        return dict(self.variables[name][1]) | ({"rounded_to": ROUNDED_M} if self._is_rounded(name) else {})


def _unknown(dtype: np.dtype[Any]) -> float:
    return np.nan if dtype.kind == "f" else 0


def _stacked(
    layers: Sequence[ArrayLike], size: tuple[int, int, int], type_: np.dtype[Any], attributes: Mapping[str, Any]
) -> xr.Variable:
    """A variable of maps, of which those that are on disk are read layer by layer when they are used."""
    import xarray as xr
    from xarray.backends import BackendArray
    from xarray.core import indexing

    class Stack(BackendArray):
        shape, dtype = size, type_

        def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
            return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.BASIC, self._read)

        def _read(self, key: tuple[int | slice, ...]) -> NDArray[Any]:
            numbers, place = np.arange(len(layers))[key[0]], key[1:]
            if not numbers.ndim:
                return np.asarray(layers[int(numbers)])[place]
            return np.array([np.asarray(layers[number])[place] for number in numbers])

    return xr.Variable(DIMENSIONS, indexing.LazilyIndexedArray(Stack()), dict(attributes))
