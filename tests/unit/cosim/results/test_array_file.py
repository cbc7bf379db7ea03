"""Arrays in a file: what was written is read, whatever their order, type and size, and NumPy reads them too."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from inkloop.results import array_file
from inkloop.results.array_file import opened, write_arrays
from inkloop.results.stored_maps import mapped_rows

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


@pytest.mark.parametrize(("small", "piece"), [(1 << 18, 1 << 20), (0, 7)], ids=["copied", "in pieces"])
def test_arrays_are_read_as_they_were_written(
    small: int, piece: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(array_file, "_SMALL", small)
    monkeypatch.setattr(array_file, "_CHUNK", piece)
    path = tmp_path / "arrays.npz"
    with path.open("wb") as file:
        write_arrays(file, ARRAYS.items())
    with opened(path) as found, np.load(path) as by_numpy:
        mapped = mapped_rows(path)
        assert list(found) == list(by_numpy) == list(mapped) == list(ARRAYS)
        for name, array in ARRAYS.items():
            for other in (found[name], by_numpy[name], mapped[name]):
                assert (other.dtype, other.shape, other.tolist()) == (array.dtype, array.shape, array.tolist())
        with pytest.raises(KeyError):
            found["none"]


def test_array_with_a_byte_changed_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "arrays.npz"
    with path.open("wb") as file:
        write_arrays(file, ARRAYS.items())
    content = bytearray(path.read_bytes())
    content[content.index(MAP.tobytes()) + 3] ^= 1
    path.write_bytes(content)
    with opened(path) as found, pytest.raises(array_file.UNREADABLE, match=r"Bad CRC-32 for file 'map\.npy'"):
        found["map"]


def test_array_shorter_than_its_header_says_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "arrays.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("map.npy", array_file._header(MAP.dtype, MAP.shape) + MAP[:2].tobytes())
    with opened(path) as found, pytest.raises(array_file.UNREADABLE, match="smaller"):
        found["map"]
