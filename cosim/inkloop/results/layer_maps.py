"""The maps of a print by layer: put together in memory, or written to a netCDF file one at a time.

A file takes a few maps of memory, whatever the number of layers.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from io import FileIO
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from inkloop.component import Job
from inkloop.limits import ROUNDED_CELLS
from inkloop.results import netcdf
from inkloop.results.attributes import variable
from inkloop.results.solid import INK, mismatch

if TYPE_CHECKING:
    import xarray as xr
    from typing_extensions import Buffer

DIMENSIONS = ("layer", "x", "y")
_CHUNK_SIDE, _CHUNK_CELLS = 256, 1 << 16
"""A chunk holds tiles of a large map, several layers of a small one: what is read is a layer, a row, or one cell."""
_BAND_CELLS = 1 << 21
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
    rows: Iterable[tuple[str, int, NDArray[Any]]]
    job: Job | None = None

    @property
    def nbytes(self) -> int:
        """Bytes of all maps."""
        return prod(self.shape) * sum(dtype.itemsize for dtype, _ in self.variables.values())

    @classmethod
    def taken_from(cls, run: xr.Dataset) -> tuple[xr.Dataset, LayerMaps]:
        """A dataset without its maps by layer, and these."""
        found = {str(name): run.variables[name] for name in run.data_vars if run.variables[name].dims == DIMENSIONS}
        count, nx, ny = (int(run.sizes[name]) for name in DIMENSIONS)
        variables = {name: (values.dtype, values.attrs) for name, values in found.items()}
        rows = ((name, layer, found[name][layer].values) for name in found for layer in range(count))
        return run.drop_vars(list(found)), cls((count, nx, ny), variables, rows)

    def added_to(self, table: xr.Dataset) -> xr.Dataset:
        """The dataset with these maps, in memory."""
        arrays = {
            name: np.full(self.shape, _unknown(dtype), dtype=dtype) for name, (dtype, _) in self.variables.items()
        }
        self._fill(arrays)
        maps = {name: (DIMENSIONS, values, self._attributes(name)) for name, values in arrays.items()}
        return table.assign({**maps, **self._derived(arrays)})

    def laid_over(self, table: xr.Dataset) -> xr.Dataset:
        """The dataset with these maps where they are: each is read when it is used."""
        from inkloop.results.stored_maps import stacked

        layers: dict[str, list[NDArray[Any] | None]] = {name: [None] * self.shape[0] for name in self.variables}
        for name, layer, map_ in self.rows:
            if layer < self.shape[0]:
                layers[name][layer] = map_
        maps = {
            name: stacked(layers[name], np.full(self.shape[1:], _unknown(dtype), dtype), attributes)
            for name, (dtype, attributes) in self.variables.items()
        }
        return table.assign({**maps, **self._derived(maps)})

    def write(self, path: Path, table: xr.Dataset) -> None:
        """Write the dataset with these maps as netCDF. Raises OSError."""
        import h5py

        with path.open("w+b", buffering=0) as raw:
            file = _FileOfHdf5(raw)
            file.write(netcdf.packed(table))
            file.check()
            with h5py.File(file, "r+") as stored:
                arrays = {name: self._new_variable(stored, name) for name in self.variables}
                self._fill({name: netcdf.ChunkedMaps(array) for name, array in arrays.items()}, file.check)
                for name, scalar in self._derived(arrays).items():
                    netcdf.add(stored, name, (), scalar.dtype, scalar.attrs)[()] = scalar.values
            file.check()

    def _fill(self, arrays: Mapping[str, Any], check: Callable[[], None] = lambda: None) -> None:
        """Put every map into its place in `arrays`, with a check after each write."""
        together = self._chunks[0]
        for name, first, maps in _neighbours((row for row in self.rows if row[1] < self.shape[0]), together):
            layers = slice(first, first + len(maps))
            for rows in _bands(maps[0].shape):
                arrays[name][layers, rows] = self._stored(name, np.stack([map_[rows] for map_ in maps]))
                check()

    @property
    def _chunks(self) -> tuple[int, int, int]:
        count, nx, ny = self.shape
        return min(count, max(1, _CHUNK_CELLS // (nx * ny))), min(nx, _CHUNK_SIDE), min(ny, _CHUNK_SIDE)

    def _derived(self, arrays: Mapping[str, Any]) -> dict[str, xr.Variable]:
        """What follows from all maps."""
        if self.job is None or self.job.region is None or INK not in arrays:
            return {}
        return {"mismatch": variable("mismatch", (), mismatch(arrays["height"], arrays[INK], self.job), "1")}

    def _is_rounded(self, name: str) -> bool:
        _, nx, ny = self.shape
        dtype, attributes = self.variables[name]
        return nx * ny > ROUNDED_CELLS and dtype.kind == "f" and attributes.get("units") == "m"

    def _attributes(self, name: str) -> dict[str, Any]:
        return dict(self.variables[name][1]) | ({"rounded_to": ROUNDED_M} if self._is_rounded(name) else {})

    def _stored(self, name: str, values: NDArray[Any]) -> NDArray[Any]:
        if self._is_rounded(name):
            values = values / ROUNDED_M
            np.rint(values, out=values)
            values *= ROUNDED_M
        return values

    def _new_variable(self, stored: Any, name: str) -> Any:
        """A variable of a netCDF file as xarray would write it."""
        dtype, filters = np.dtype(self.variables[name][0]), netcdf.ChunkedMaps.FILTERS
        return netcdf.add(stored, name, DIMENSIONS, dtype, self._attributes(name), chunks=self._chunks, **filters)


def _neighbours(
    rows: Iterable[tuple[str, int, NDArray[Any]]], together: int
) -> Iterator[tuple[str, int, list[NDArray[Any]]]]:
    """Name, first layer and maps of neighbouring layers, those of a chunk together: each write takes its time."""
    held: dict[str, tuple[int, list[NDArray[Any]]]] = {}
    for name, layer, map_ in rows:
        first, maps = held.get(name, (layer, []))
        if layer != first + len(maps):
            yield name, first, maps
            first, maps = layer, []
        maps.append(map_)
        held[name] = first, maps
        if (layer + 1) % together == 0:
            yield name, *held.pop(name)
    yield from ((name, *last) for name, last in held.items())


def _bands(shape: tuple[int, ...]) -> Iterator[slice]:
    """Rows of a map that are compressed together, in whole chunks: what is done to them takes little memory."""
    rows = max(_CHUNK_SIDE, _BAND_CELLS // shape[1] // _CHUNK_SIDE * _CHUNK_SIDE)
    yield from (slice(first, first + rows) for first in range(0, shape[0], rows))


def _unknown(dtype: np.dtype[Any]) -> float:
    return np.nan if dtype.kind == "f" else 0


class _FileOfHdf5:
    """A file for HDF5, which ends the process where its file cannot grow: the first error is kept for `check`."""

    def __init__(self, raw: FileIO) -> None:
        self._raw = raw
        self._error: OSError | None = None

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        return self._raw.seek(offset, whence)

    def tell(self) -> int:
        return self._raw.tell()

    def read(self, size: int = -1) -> bytes:
        return self._raw.read(size)

    def readinto(self, into: memoryview) -> int:
        """Fill `into`; what could not be written reads as zeros."""
        found = self._raw.readinto(into)
        into[found:] = bytes(len(into) - found)
        return len(into)

    def write(self, content: Buffer) -> int:
        """Write all of it; nothing after an error."""
        left = memoryview(content).cast("B")
        size = len(left)
        try:
            while len(left) and self._error is None:
                left = left[self._raw.write(left) :]
        except OSError as error:
            self._error = error
        return size

    def truncate(self, size: int) -> int:
        try:
            return self._raw.truncate(size)
        except OSError as error:
            self._error = self._error or error
        return size

    def flush(self) -> None:
        """Nothing is held back."""

    def check(self) -> None:
        """Raises the first OSError, if there was one."""
        if self._error is not None:
            raise self._error
