"""NetCDF-4 files of labelled arrays, by h5py alone: HDF5 files whose dimensions are dimension scales.

xarray reads and writes the same files through h5netcdf, which takes five times as long: it looks each name up again and
again. Format: NetCDF-4 File Format, Unidata, and the conventions of xarray for what NetCDF has no type for (bool).
"""

from __future__ import annotations

import io
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from io import FileIO
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from inkloop.files import regular
from inkloop.results.attributes import as_index

if TYPE_CHECKING:
    import h5py
    import xarray as xr
    from typing_extensions import Buffer

__all__ = ["packed"]

_PLUMBING = {"CLASS", "NAME", "REFERENCE_LIST", "DIMENSION_LIST", "DIMENSION_LABELS", "_FillValue"}
_PLUMBING |= {"_NCProperties", "_Netcdf4Coordinates", "_Netcdf4Dimid"}
"""Attributes of HDF5 and NetCDF themselves; a missing value of ours is NaN."""
_CHUNK_SIDE, _CHUNK_CELLS = 256, 1 << 16
"""A chunk holds tiles of a large map, several layers of a small one: what is read is a layer, a row, or one cell."""


def packed(dataset: xr.Dataset) -> memoryview:
    """The file as bytes. Each dimension has its coordinates, else KeyError."""
    import h5py

    image = io.BytesIO()
    with h5py.File(image, "w", track_order=True) as file:
        store(file, dataset)
    return image.getbuffer()


def write(path: Path, dataset: xr.Dataset) -> None:
    """Write the file. Raises OSError."""
    with created(path) as (file, _):
        store(file, dataset)


@contextmanager
def created(path: Path) -> Iterator[tuple[h5py.File, Callable[[], None]]]:
    """A new file, and a call that raises OSError if the file could not grow; the end of the block calls it, too."""
    import h5py

    with _HiddenErrors(path, "w+b") as disk:
        with h5py.File(disk, "w", track_order=True) as file:
            yield file, disk.check
        disk.check()


def store(file: h5py.File, dataset: xr.Dataset) -> None:
    """Put a dataset into a new file; maps that are on disk are read a chunk of layers at a time."""
    _annotate(file, dataset.attrs)
    for number, dimension in enumerate(map(str, dataset.sizes)):
        put(file, dimension, dataset.variables[dimension])
        file[dimension].make_scale(dimension)
        file[dimension].attrs["_Netcdf4Dimid"] = np.int32(number)
    for name, variable in dataset.variables.items():
        if name not in dataset.sizes:
            put(file, str(name), variable)


def put(file: h5py.File, name: str, variable: xr.Variable) -> None:
    """A variable with its values."""
    stored = add(file, name, tuple(map(str, variable.dims)), variable.shape, variable.dtype, variable.attrs)
    if variable.dtype.kind in "OU":
        stored[...] = variable.values.astype(object)
    elif stored.chunks:
        for first in range(0, len(stored), stored.chunks[0]):
            fill(stored, first, variable[first : first + stored.chunks[0]].values)
    else:
        stored[...] = variable.values


def fill(stored: h5py.Dataset, first: int, values: NDArray[Any]) -> None:
    """Write layers into a variable of maps, compressed by runs alone where they fill their chunks.

    HDF5's own filter also looks for repetitions, of which the noise of heights has none: it takes 1.6 times the time.
    """
    size, after = stored.chunks, first + len(values)
    if first % size[0] or (after % size[0] and after < len(stored)):
        stored[first:after] = values
        return
    for corner in product(*map(range, (0,) * values.ndim, values.shape, size)):
        part = values[tuple(slice(at, at + side) for at, side in zip(corner, size, strict=True))]
        chunk = np.zeros(size, stored.dtype)
        chunk[tuple(map(slice, part.shape))] = part
        stored.id.write_direct_chunk((first + corner[0], *corner[1:]), _filtered(chunk))


def add(
    file: h5py.File,
    name: str,
    dimensions: tuple[str, ...],
    shape: tuple[int, ...],
    dtype: np.dtype[Any],
    attributes: Mapping[Any, Any],
) -> h5py.Dataset:
    """A variable without its values, which are NaN or 0 until they are put in; maps are compressed."""
    import h5py

    options: dict[str, Any] = {"dtype": dtype}
    if dtype.kind in "OU":
        options["dtype"] = h5py.string_dtype()  # texts, of any length each
    elif len(shape) > 1 and all(shape):
        options |= {"compression": "gzip", "compression_opts": 1, "shuffle": True, "chunks": _chunks(shape)}
    if dtype == np.bool_:
        options["dtype"], attributes = np.int8, {**attributes, "dtype": "bool"}
    if dtype.kind == "f":
        options["fillvalue"] = np.nan
    stored = file.create_dataset(name, shape, **options)
    if dtype.kind == "f" and dimensions != (name,):
        stored.attrs["_FillValue"] = np.full(1, np.nan, dtype)
    _annotate(stored, attributes)
    for axis, dimension in zip(stored.dims, dimensions, strict=True):
        if dimension != name:
            axis.attach_scale(file[dimension])
    return stored


def read(path: Path, bytes_at_once: int | None = None) -> xr.Dataset:
    """A file by this module or xarray; a dataset with more bytes than this is read by xarray when it is used.

    Raises OSError, ValueError or KeyError for a file that is not whole.
    """
    import h5py
    import xarray as xr

    with h5py.File(regular(path), "r") as file:
        stored = dict(file.items())
        if bytes_at_once is None or sum(array.nbytes for array in stored.values()) <= bytes_at_once:
            names = {_address(array.id): name for name, array in stored.items() if array.is_scale}
            variables = {name: xr.Variable(*_restored(array, name, names)) for name, array in stored.items()}
            return xr.Dataset(variables, attrs=_attributes(file))
    return xr.open_dataset(path, engine="h5netcdf", cache=False)


class _HiddenErrors(FileIO):
    """A file for HDF5, which ends the process where its file cannot grow: the first error is kept for `check`."""

    _error: OSError | None = None

    def readinto(self, into: Buffer) -> int:
        """Fill `into`; bytes that could not be written read as zeros."""
        place = memoryview(into).cast("B")
        found = super().readinto(place) or 0
        place[found:] = bytes(len(place) - found)
        return len(place)

    def write(self, content: Buffer) -> int:
        """Write all of it; nothing after an error."""
        left = memoryview(content).cast("B")
        size = len(left)
        try:
            while len(left) and self._error is None:
                left = left[super().write(left) or 0 :]
        except OSError as error:
            self._error = error
        return size

    def truncate(self, size: int | None = None) -> int:
        try:
            return super().truncate(size)
        except OSError as error:
            self._error = self._error or error
        return size or 0

    def check(self) -> None:
        """Raises the first OSError, if there was one."""
        if self._error is not None:
            raise self._error


def _chunks(shape: tuple[int, ...]) -> tuple[int, ...]:
    *others, nx, ny = shape
    layers = [max(1, _CHUNK_CELLS // (nx * ny)), *(1 for _ in others)]
    return (*map(min, others, layers), min(nx, _CHUNK_SIDE), min(ny, _CHUNK_SIDE))


def _filtered(chunk: NDArray[Any]) -> bytes:
    """As HDF5 shuffles and deflates it: the first bytes of all values, then the second ones, ..."""
    packing = zlib.compressobj(1, strategy=zlib.Z_RLE)
    planes = chunk.view(np.uint8).reshape(-1, chunk.itemsize).T
    return b"".join((*(packing.compress(plane.tobytes()) for plane in planes), packing.flush()))


def _annotate(place: h5py.File | h5py.Dataset, attributes: Mapping[Any, Any]) -> None:
    """Texts as texts, numbers as arrays of one dimension, as NetCDF has them."""
    for name, value in attributes.items():
        place.attrs[name] = value if isinstance(value, str) else np.atleast_1d(value)


def _address(identifier: h5py.h5d.DatasetID) -> int:
    """Where in its file a dataset begins."""
    import h5py

    return int(h5py.h5o.get_info(identifier).addr)


def _restored(stored: h5py.Dataset, name: str, names: Mapping[int, str]) -> tuple[tuple[str, ...], Any, dict[str, Any]]:
    """Dimensions, values and attributes of a variable; names: of the dimensions, by the address of their scales.

    HDF5 would look through the whole file for the name of what a reference leads to.
    """
    import h5py

    attributes = _attributes(stored)
    values = stored.asstr()[()] if h5py.check_string_dtype(stored.dtype) else stored[()]
    if attributes.pop("dtype", None) == "bool":
        values = values.astype(np.bool_)
    if stored.is_scale:
        return (name,), as_index(values), attributes
    scales = stored.attrs["DIMENSION_LIST"] if stored.ndim else ()
    targets = [h5py.h5r.dereference(references[0], stored.id) for references in scales]
    return tuple(names[_address(target)] for target in targets), values, attributes


def _attributes(place: h5py.File | h5py.Dataset) -> dict[str, Any]:
    found = {name: place.attrs[name] for name in place.attrs if name not in _PLUMBING}
    return {name: value[0] if getattr(value, "shape", None) == (1,) else value for name, value in found.items()}
