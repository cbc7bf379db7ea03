"""NetCDF-4 files of labelled arrays, by h5py alone: HDF5 files whose dimensions are dimension scales.

xarray reads and writes the same files through h5netcdf, which takes ten times as long: it looks each name up again and
again. Format: NetCDF-4 File Format, Unidata, and the conventions of xarray for what NetCDF has no type for (bool).
"""

from __future__ import annotations

import io
import zlib
from collections.abc import Mapping
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from inkloop.results.attributes import as_index

if TYPE_CHECKING:
    import h5py
    import xarray as xr

__all__ = ["packed"]

_PLUMBING = {"CLASS", "NAME", "REFERENCE_LIST", "DIMENSION_LIST", "DIMENSION_LABELS", "_FillValue"}
_PLUMBING |= {"_NCProperties", "_Netcdf4Coordinates", "_Netcdf4Dimid"}
"""Attributes of HDF5 and NetCDF themselves; a missing value of ours is NaN."""


def packed(dataset: xr.Dataset) -> memoryview:
    """The file as bytes; maps are compressed. Each dimension has its coordinates, else KeyError."""
    import h5py

    image = io.BytesIO()  # HDF5 ends the process where a file that it writes itself cannot grow
    with h5py.File(image, "w", track_order=True) as file:
        _annotate(file, dataset.attrs)
        variables = {str(name): variable for name, variable in dataset.variables.items()}
        for name, variable in variables.items():
            _store(file, name, variable)
        for number, dimension in enumerate(map(str, dataset.sizes)):
            file[dimension].make_scale(dimension)
            file[dimension].attrs["_Netcdf4Dimid"] = np.int32(number)
        for name, variable in variables.items():
            _attach(file, name, tuple(map(str, variable.dims)))
    return image.getbuffer()


def read(path: Path, bytes_at_once: int | None = None) -> xr.Dataset:
    """What `packed` or xarray wrote; a dataset with more bytes than this is read by xarray when it is used.

    Raises OSError, ValueError or KeyError for a file that is not whole.
    """
    import h5py
    import xarray as xr

    with h5py.File(path, "r") as file:
        stored = dict(file.items())
        if bytes_at_once is None or sum(array.nbytes for array in stored.values()) <= bytes_at_once:
            names = {_address(array.id): name for name, array in stored.items() if array.is_scale}
            variables = {name: xr.Variable(*_restored(array, name, names)) for name, array in stored.items()}
            return xr.Dataset(variables, attrs=_attributes(file))
    return xr.open_dataset(path, engine="h5netcdf", cache=False)


class ChunkedMaps:
    """A variable (layer, x, y) of a file, made with `FILTERS`, whose chunks are compressed here: by runs alone.

    HDF5's own filter also looks for repetitions, of which the noise of heights has none: it takes 1.6 times the time
    and a fifteenth more room. What does not fill its chunks is left to it.
    """

    FILTERS: ClassVar[Mapping[str, Any]] = {"compression": "gzip", "compression_opts": 1, "shuffle": True}

    def __init__(self, stored: h5py.Dataset) -> None:
        self._stored = stored

    def __setitem__(self, place: tuple[slice, slice], maps: NDArray[Any]) -> None:
        """Write rows of neighbouring layers."""
        size, first = self._stored.chunks, (place[0].start, place[1].start, 0)
        sides = zip(first, maps.shape, size, self._stored.shape, strict=True)
        if any(at % chunk or (length % chunk and at + length < end) for at, length, chunk, end in sides):
            self._stored[place] = maps
            return
        for corner in product(*map(range, (0, 0, 0), maps.shape, size)):
            part = maps[tuple(slice(at, at + chunk) for at, chunk in zip(corner, size, strict=True))]
            chunk = np.zeros(size, self._stored.dtype)
            chunk[tuple(map(slice, part.shape))] = part
            place_of_chunk = tuple(a + b for a, b in zip(first, corner, strict=True))
            self._stored.id.write_direct_chunk(place_of_chunk, _filtered(chunk))


def _filtered(chunk: NDArray[Any]) -> bytes:
    """As HDF5 shuffles and deflates it: the first bytes of all values, then the second ones, ..."""
    packing = zlib.compressobj(1, strategy=zlib.Z_RLE)
    planes = chunk.view(np.uint8).reshape(-1, chunk.itemsize).T
    return b"".join((*(packing.compress(plane.tobytes()) for plane in planes), packing.flush()))


def add(
    file: h5py.File,
    name: str,
    dimensions: tuple[str, ...],
    dtype: np.dtype[Any],
    attributes: Mapping[str, Any],
    **options: Any,
) -> h5py.Dataset:
    """A variable without its values, which are NaN or 0 until they are put in. options: of `h5py.create_dataset`."""
    shape, is_bool = tuple(len(file[dimension]) for dimension in dimensions), dtype == np.bool_
    if dtype.kind == "f":
        options |= {"fillvalue": np.nan}
    stored = file.create_dataset(name, shape, np.int8 if is_bool else dtype, **options)
    _describe(stored, dtype, attributes, is_coordinate=False)
    _attach(file, name, dimensions)
    return stored


def _store(file: h5py.File, name: str, variable: xr.Variable) -> None:
    values, options = variable.values, dict[str, Any]()
    if values.dtype.kind in "OU":  # texts, of any length each
        _describe(file.create_dataset(name, data=values.astype(object), dtype=_text()), _text(), variable.attrs)
        return
    if variable.ndim > 1 and values.size:
        options |= {"compression": "gzip", "compression_opts": 4}
    if values.dtype.kind == "f":
        options |= {"fillvalue": np.nan}
    is_bool = values.dtype == np.bool_
    stored = file.create_dataset(name, data=values.astype(np.int8) if is_bool else values, **options)
    _describe(stored, values.dtype, variable.attrs, is_coordinate=variable.dims == (name,))


def _text() -> np.dtype[Any]:
    import h5py

    found: np.dtype[Any] = np.dtype(h5py.string_dtype())
    return found


def _describe(
    stored: h5py.Dataset, dtype: np.dtype[Any], attributes: Mapping[Any, Any], is_coordinate: bool = False
) -> None:
    if dtype.kind == "f" and not is_coordinate:
        stored.attrs["_FillValue"] = np.full(1, np.nan, dtype)
    _annotate(stored, {**attributes, **({"dtype": "bool"} if dtype == np.bool_ else {})})


def _attach(file: h5py.File, name: str, dimensions: tuple[str, ...]) -> None:
    for axis, dimension in zip(file[name].dims, dimensions, strict=True):
        if dimension != name:
            axis.attach_scale(file[dimension])


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
    values = stored.asstr()[()] if stored.dtype == _text() else stored[()]
    if attributes.get("dtype") == "bool":
        del attributes["dtype"]
        values = values.astype(np.bool_)
    if stored.is_scale:
        return (name,), as_index(values), attributes
    scales = stored.attrs["DIMENSION_LIST"] if stored.ndim else ()
    targets = [h5py.h5r.dereference(references[0], stored.id) for references in scales]
    return tuple(names[_address(target)] for target in targets), values, attributes


def _attributes(place: h5py.File | h5py.Dataset) -> dict[str, Any]:
    found = {name: place.attrs[name] for name in place.attrs if name not in _PLUMBING}
    return {name: value[0] if getattr(value, "shape", None) == (1,) else value for name, value in found.items()}
