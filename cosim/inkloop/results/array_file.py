"""Arrays by name in a file, as NumPy's npz, of which one at a time is in memory."""

from __future__ import annotations

import io
import shutil
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from math import prod
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

UNREADABLE = (OSError, ValueError, KeyError, zipfile.BadZipFile)
"""What reading such a file raises."""
_SMALL = 1 << 18
"""Bytes of an array that is copied to be written or read: the headers of such arrays recur from layer to layer."""
_LENGTH = slice(8, 10)
"""Where a header says how long its rest is, in the NPY format 1.0."""
_CHUNK = 1 << 20
"""Bytes of a large array that are read or written at a time."""


def write_arrays(file: IO[bytes], arrays: Iterable[tuple[str, NDArray[Any]]]) -> None:
    """Write arrays, each taken when it is its turn. Raises OSError, and what taking them raises."""
    with zipfile.ZipFile(_InOrder(file), "w", allowZip64=True) as archive:
        for name, array in arrays:
            if not array.flags.c_contiguous or array.dtype.hasobject:
                with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                    np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)
            elif array.nbytes < _SMALL:
                archive.writestr(zipfile.ZipInfo(f"{name}.npy"), _header(array.dtype, array.shape) + array.tobytes())
            else:
                with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                    _write_in_pieces(member, array)
            del array  # it may be large, and the next one is made now


def _write_in_pieces(file: IO[bytes], array: NDArray[Any]) -> None:
    """Write an array in C order without a copy, where NumPy would make one of each piece."""
    file.write(_header(array.dtype, array.shape))
    content = array.reshape(-1).view(np.uint8)
    for begin in range(0, content.size, _CHUNK):
        file.write(content[begin : begin + _CHUNK].data)


class _InOrder:
    """A file that is written in order: zipfile would return to each member's header, and empty the buffer each time."""

    def __init__(self, file: IO[bytes]) -> None:
        self.write, self.flush, self.close = file.write, file.flush, file.close


@lru_cache(256)
def _header(dtype: np.dtype[Any], shape: tuple[int, ...]) -> bytes:
    """What stands before the elements of an array in C order."""
    header = io.BytesIO()
    described = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(header, described)
    return header.getvalue()


def read_header(file: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Shape, whether in Fortran order, and type of an array, to whose elements this reads. Raises ValueError."""
    is_first = np.lib.format.read_magic(file) == (1, 0)
    read = np.lib.format.read_array_header_1_0 if is_first else np.lib.format.read_array_header_2_0
    return read(file)


@lru_cache(256)
def _described(header: bytes) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    return read_header(io.BytesIO(header))


@contextmanager
def opened(path: Path) -> Iterator[Mapping[str, NDArray[Any]]]:
    """The arrays of a file, each read when it is asked for. Raises what is in UNREADABLE."""
    with zipfile.ZipFile(path) as archive:
        yield _StoredArrays(archive)


class _StoredArrays(Mapping[str, NDArray[Any]]):
    """The arrays of an open file; small ones cannot be written to."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive = archive
        self._names = [name.removesuffix(".npy") for name in archive.namelist()]

    def __getitem__(self, name: str) -> NDArray[Any]:
        member = self._archive.getinfo(f"{name}.npy")
        if member.file_size < _SMALL:
            content = self._archive.read(member)
            begin = _LENGTH.stop + int.from_bytes(content[_LENGTH], "little")
            shape, is_fortran, dtype = _described(content[:begin])
            elements = np.frombuffer(content, dtype, prod(shape), begin)
            return elements.reshape(shape, order="F" if is_fortran else "C")
        with self._archive.open(member) as stored:
            found: NDArray[Any] = np.lib.format.read_array(stored, allow_pickle=False)
        return found

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


def bytes_of(path: Path, name: str) -> bytes:
    """The content of an array, which is once in memory."""
    with zipfile.ZipFile(path) as archive, archive.open(f"{name}.npy") as member:
        read_header(member)
        content = io.BytesIO()
        shutil.copyfileobj(member, content, _CHUNK)  # ZipExtFile.read joins what it reads, which is then there twice
    return content.getvalue()


def check(path: Path) -> list[str]:
    """The names of the arrays of a file, after all of it was read once. Raises what is in UNREADABLE."""
    with zipfile.ZipFile(path) as archive:
        if bad := archive.testzip():
            raise zipfile.BadZipFile(f"bad CRC-32 of {bad}")
        return [name.removesuffix(".npy") for name in archive.namelist()]


def read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """All arrays of a file."""
    with opened(path) as stored:
        return dict(stored)
