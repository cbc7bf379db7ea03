"""NetCDF-4 files of labelled arrays, by h5py alone: HDF5 files whose dimensions are dimension scales.

xarray reads and writes the same files through h5netcdf, which takes ten times as long: it looks each name up again and
again. Format: NetCDF-4 File Format, Unidata, and the conventions of xarray for what NetCDF has no type for (bool).
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import h5py
    import xarray as xr

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
            for axis, dimension in zip(file[name].dims, map(str, variable.dims), strict=True):
                if dimension != name:
                    axis.attach_scale(file[dimension])
    return image.getbuffer()


def read(path: Path) -> xr.Dataset:
    """What `packed` or xarray wrote. Raises OSError, ValueError or KeyError for a file that is not whole."""
    import h5py
    import xarray as xr

    with h5py.File(path, "r") as file:
        variables = {name: xr.Variable(*_restored(file, name)) for name in file}
        return xr.Dataset(variables, attrs=_attributes(file))


def _store(file: h5py.File, name: str, variable: xr.Variable) -> None:
    values, options = variable.values, dict[str, Any]()
    if variable.ndim > 1 and values.size:
        options |= {"compression": "gzip", "compression_opts": 4}
    if values.dtype.kind == "f":
        options |= {"fillvalue": np.nan}
    is_bool = values.dtype == np.bool_
    stored = file.create_dataset(name, data=values.astype(np.int8) if is_bool else values, **options)
    if values.dtype.kind == "f" and variable.dims != (name,):
        stored.attrs["_FillValue"] = np.full(1, np.nan, values.dtype)
    _annotate(stored, {**variable.attrs, **({"dtype": "bool"} if is_bool else {})})


def _annotate(place: h5py.File | h5py.Dataset, attributes: Mapping[Any, Any]) -> None:
    """Texts as texts, numbers as arrays of one dimension, as NetCDF has them."""
    for name, value in attributes.items():
        place.attrs[name] = value if isinstance(value, str) else np.atleast_1d(value)


def _restored(file: h5py.File, name: str) -> tuple[tuple[str, ...], Any, dict[str, Any]]:
    """Dimensions, values and attributes of a variable."""
    stored = file[name]
    attributes = _attributes(stored)
    values = stored[()]
    if attributes.get("dtype") == "bool":
        del attributes["dtype"]
        values = values.astype(np.bool_)
    if stored.is_scale:
        return (name,), values, attributes
    scales = stored.attrs["DIMENSION_LIST"] if stored.ndim else ()
    return tuple(file[references[0]].name.removeprefix("/") for references in scales), values, attributes


def _attributes(place: h5py.File | h5py.Dataset) -> dict[str, Any]:
    found = {name: place.attrs[name] for name in place.attrs if name not in _PLUMBING}
    return {name: value[0] if getattr(value, "shape", None) == (1,) else value for name, value in found.items()}
