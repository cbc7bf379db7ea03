"""Arrays in a file: read as they were written, by NumPy too; a damaged file is not read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from inkloop.errors import ResultError
from inkloop.results import array_file
from inkloop.results.array_file import StoredArray, opened, write_arrays

MAP = np.arange(12.0).reshape(3, 4)
ARRAYS: dict[str, NDArray[Any]] = {
    "map": MAP,
    "in Fortran order": np.asfortranarray(MAP),
    "every second row": MAP[::2],
    "of no row": np.zeros((0, 4), np.int32),
    "number": np.asarray(np.pi),
    "a/valid": MAP > 5.0,
    "text": np.array("größer"),
    "table": np.array([("a/ä/7", 3), ("b", -1)], [("place", "U6"), ("value", np.int32)]),
}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    with (tmp_path / "arrays.npz").open("wb") as file:
        write_arrays(file, ARRAYS.items())
    return tmp_path / "arrays.npz"


def test_arrays_are_read_as_they_were_written(path: Path) -> None:
    with opened(path) as found:
        assert list(found) == array_file.check(path) == list(ARRAYS)
        for name, array in ARRAYS.items():
            for other in (found[name], np.asarray(StoredArray(path, name))):
                assert (other.dtype, other.shape, other.tolist()) == (array.dtype, array.shape, array.tolist())
        with pytest.raises(KeyError):
            found["none"]


def test_stored_array_whose_run_has_ended_says_so(path: Path) -> None:
    path.unlink()
    with pytest.raises(ResultError, match=r"arrays\.npz: is gone: the run has ended"):
        np.asarray(StoredArray(path, "map"))


def test_array_with_a_byte_changed_is_not_read(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[content.index(MAP.tobytes()) + 3] ^= 1
    path.write_bytes(content)
    with opened(path) as found, pytest.raises(array_file.UNREADABLE, match=r"Bad CRC-32 for file 'map\.npy'"):
        found["map"]
    with pytest.raises(array_file.UNREADABLE, match="bad CRC-32 of map"):
        array_file.check(path)


def test_file_that_is_cut_off_is_not_read(path: Path) -> None:
    content = path.read_bytes()
    for share in (0.99, 0.5, 0.01, 0.0):
        path.write_bytes(content[: round(share * len(content))])
        with pytest.raises(array_file.UNREADABLE):
            opened(path)
