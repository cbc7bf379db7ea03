"""The maps of layers where they are on disk: mapped into memory, so that only what is used takes any.

A mapped file stays readable after it was removed or replaced.
"""

from __future__ import annotations

import struct
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from xarray.backends import BackendArray
from xarray.core import indexing

from inkloop.results.array_file import read_header

_LOCAL_HEADER = struct.Struct("<26xHH")
"""Of a member of a ZIP file: the lengths of its name and of what else stands before its bytes."""


def mapped_rows(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of an NPZ file by name, those with a dimension as maps of the file, which must not be compressed.

    Raises OSError, ValueError, BadZipFile.
    """
    rows: dict[str, NDArray[Any]] = {}
    with path.open("rb") as file, zipfile.ZipFile(file) as archive:
        for member in archive.infolist():
            if member.compress_type != zipfile.ZIP_STORED:
                raise ValueError(f"{member.filename} is compressed")
            file.seek(member.header_offset)
            header = file.read(_LOCAL_HEADER.size)
            file.seek(sum(_LOCAL_HEADER.unpack(header)), 1)
            rows[member.filename.removesuffix(".npy")] = _array_at(file)
    return rows


def stacked(layers: Sequence[NDArray[Any] | None], empty: NDArray[Any], attributes: Any) -> xr.Variable:
    """A variable (layer, x, y) of maps (nx, ny), read layer by layer when they are used; `empty` for None."""
    lazy = indexing.LazilyIndexedArray(_Stack([empty if layer is None else layer for layer in layers]))
    return xr.Variable(("layer", "x", "y"), lazy, dict(attributes))


def _array_at(file: IO[bytes]) -> NDArray[Any]:
    """The array in NPY form from the present place of a file on."""
    shape, is_fortran, dtype = read_header(file)
    if not shape:
        return np.fromfile(file, dtype, 1).reshape(())
    order = "F" if is_fortran else "C"
    return np.memmap(file, dtype, "r", offset=file.tell(), shape=shape, order=order)  # type: ignore[call-overload,no-any-return]


class _Stack(BackendArray):
    """Maps of equal shape and type, one for each layer."""

    def __init__(self, layers: Sequence[NDArray[Any]]) -> None:
        self._layers = layers
        self.shape = (len(layers), *layers[0].shape)
        self.dtype = layers[0].dtype

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.BASIC, self._read)

    def _read(self, key: tuple[int | slice, ...]) -> NDArray[Any]:
        layers, *place = key
        if not isinstance(layers, slice):
            return np.array(self._layers[layers][tuple(place)])
        return np.array([layer[tuple(place)] for layer in self._layers[layers]])
