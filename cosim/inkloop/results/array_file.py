"""Arrays by name in a file, as NumPy's npz, of which one at a time is in memory; recorded values as such arrays."""

from __future__ import annotations

import io
import shutil
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from inkloop.errors import ResultError
from inkloop.files import regular

UNREADABLE = (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile)
"""Errors of reading such a file."""
_PIECE = 1 << 20
RUN = "run"
"""Role of recorded values of no component."""
_SCALARS = "scalars"
"""First part of the keys of tables of scalars: a file takes much less time for a few of them than for each scalar."""


def write_arrays(file: IO[bytes], arrays: Iterable[tuple[str, NDArray[Any]]]) -> None:
    """Write arrays, each taken when it is its turn. Raises OSError, and what taking them raises."""
    with zipfile.ZipFile(file, "w") as archive:
        for name, array in arrays:
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, array, allow_pickle=False)
            del array  # it may be large, and the next one is made now


def opened(path: Path) -> AbstractContextManager[Mapping[str, NDArray[Any]]]:
    """The arrays of a file, each read when it is asked for. Raises the errors in UNREADABLE."""
    found: AbstractContextManager[Mapping[str, NDArray[Any]]] = np.load(regular(path))
    return found


@dataclass(frozen=True)
class StoredArray:
    """An array of a file, for NumPy, that is read each time it is used: the file is not kept open."""

    path: Path
    name: str

    def __array__(self, dtype: np.dtype[Any] | None = None, copy: bool | None = None) -> NDArray[Any]:
        """Raises ResultError if the file is gone, and the errors in UNREADABLE."""
        try:
            with opened(self.path) as arrays:
                return arrays[self.name].astype(dtype, copy=False) if dtype else arrays[self.name]
        except FileNotFoundError as error:
            raise ResultError(f"{self.path}: is gone: the run has ended in the meantime; try again") from error


def bytes_of(path: Path, name: str) -> bytes:
    """The content of an array of bytes, which is once in memory."""
    with zipfile.ZipFile(regular(path)) as archive, archive.open(f"{name}.npy") as member:
        np.lib.format.read_magic(member)
        np.lib.format.read_array_header_1_0(member)
        content = io.BytesIO()
        shutil.copyfileobj(member, content, _PIECE)  # ZipExtFile.read joins what it reads, which is then there twice
    return content.getvalue()


def check(path: Path) -> list[str]:
    """The names of the arrays of a file, after all of it was read once. Raises the errors in UNREADABLE."""
    with zipfile.ZipFile(regular(path)) as archive:
        if bad := archive.testzip():
            raise zipfile.BadZipFile(f"bad CRC-32 of {bad}")
        return [name.removesuffix(".npy") for name in archive.namelist()]


class Place(NamedTuple):
    """The value of port `name` of the component in `role`, in the row of `layer`."""

    role: str
    name: str
    layer: int


def packed(rows: Mapping[Place, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """The rows as arrays by key: each map alone, scalars in a table for each of their types."""
    found = {f"{place.role}/{place.name}/{place.layer}": row for place, row in rows.items() if row.shape}
    scalars: dict[np.dtype[Any], list[tuple[Any, ...]]] = {}
    for place, row in rows.items():
        if not row.shape:
            scalars.setdefault(row.dtype, []).append((*place, row[()]))
    for dtype, placed in scalars.items():
        role, name = (f"U{max(len(row[column]) for row in placed)}" for column in (0, 1))
        columns = [("role", role), ("name", name), ("layer", np.int64), ("value", dtype)]
        found[f"{_SCALARS}/{dtype}/{placed[-1][2]}"] = np.array(placed, columns)
    return found


def scalars(arrays: Mapping[str, NDArray[Any]]) -> Iterator[tuple[Place, NDArray[Any]]]:
    """The scalars of arrays by key; no map is read."""
    for key in arrays:
        if key.startswith(f"{_SCALARS}/"):
            table = arrays[key]
            for role, name, layer, value in zip(*(table[column] for column in table.dtype.names or ()), strict=True):
                yield Place(str(role), str(name), int(layer)), np.asarray(value)


def keys(arrays: Mapping[str, NDArray[Any]]) -> Iterator[tuple[Place, str]]:
    """The places of all other arrays, and their keys."""
    for key in arrays:
        role, name, layer = key.split("/")
        if role != _SCALARS:
            yield Place(role, name, int(layer)), key
