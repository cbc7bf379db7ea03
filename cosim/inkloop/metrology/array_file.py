"""Height maps in NumPy's own files: an array as `numpy.save` writes it, or named arrays with their units."""

from __future__ import annotations

from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from inkloop.errors import HeightMapError
from inkloop.metrology.file_contents import FileContents
from inkloop.units import SUFFIXES

_HEIGHTS = ("z", "height")


def read_array(path: Path) -> FileContents:
    """An NPY file, or an NPZ file with `z_um` or `height_m` ... and `pixel_um`, or `dx_um` and `dy_um`.

    In an NPZ the unit stands in the key; a key without one (`z`, or the only 2-D array) leaves it to the caller.
    Raises HeightMapError, OSError.
    """
    try:
        loaded = np.load(path, allow_pickle=False)
    except (ValueError, EOFError, BadZipFile) as error:
        raise HeightMapError(f"{path}: is no array of numbers that NumPy saved ({error})") from error
    if isinstance(loaded, np.ndarray):
        return FileContents(loaded, rows_along="y")
    with loaded:
        arrays = {name: loaded[name] for name in loaded.files}
    key, unit = _heights(path, arrays)
    return FileContents(arrays[key], unit, _pixel(arrays), rows_along="y")


def _heights(path: Path, arrays: dict[str, np.ndarray]) -> tuple[str, str | None]:
    """Key of the heights and the unit in its name."""
    named: list[tuple[str, str | None]] = [
        (f"{name}_{suffix}", suffix) for name in _HEIGHTS for suffix in SUFFIXES["m"] if f"{name}_{suffix}" in arrays
    ]
    named += [(name, None) for name in _HEIGHTS if name in arrays]
    found = named or [(name, None) for name, array in arrays.items() if array.ndim == 2]
    if len(found) == 1:
        return found[0]
    listed = ", ".join(f"{name} {array.shape}" for name, array in arrays.items()) or "nothing"
    raise HeightMapError(f"{path}: holds {listed}; expected one map, named z_um, height_um or z")


def _pixel(arrays: dict[str, np.ndarray]) -> tuple[float, float] | None:
    sizes = {
        name: float(arrays[f"{name}_{suffix}"]) * factor
        for name in ("pixel", "dx", "dy")
        for suffix, factor in SUFFIXES["m"].items()
        if f"{name}_{suffix}" in arrays and arrays[f"{name}_{suffix}"].size == 1
    }
    both = sizes.get("pixel")
    dx, dy = sizes.get("dx", both), sizes.get("dy", both)
    return None if dx is None or dy is None else (dx, dy)
