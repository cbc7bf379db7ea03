"""Arrays that a problem, or C, is given: checked, and where they lie."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap
from inkloop.component_errors import error_of_form


def error_of_array(name: str, array: Any, dtype: str, shape: Sequence[int]) -> str:
    """The error of an array that must have this shape and dtype and finite values; "" if it has."""
    error = error_of_form(name, array, dtype, shape)
    if not error and dtype == "f8" and not _is_finite(array):
        cell = first_cell(~np.isfinite(array))
        error = f"{name} is {array[cell]} at cell {cell}; needs finite values"
    return error


def checked(name: str, array: Any, dtype: str, shape: Sequence[int]) -> NDArray[Any]:
    """The array in C order. Raises ValueError with its error."""
    error = error_of_array(name, array, dtype, shape)
    if error:
        raise ValueError(error)
    return np.ascontiguousarray(array)


def checked_droplets(
    pattern: Any, factor: Any, shape: Sequence[int], inks: int
) -> tuple[NDArray[np.int32], NDArray[np.float64] | None]:
    """A pattern and the volumes of its droplets, None: nominal ones, in C order. Raises ValueError with their error."""
    droplets = checked("pattern", pattern, "i4", shape)
    if droplets.size and (droplets.min() < 0 or droplets.max() > inks):
        raise ValueError(f"pattern holds {droplets.min()} to {droplets.max()}; needs 0 to {inks}, the inks given")
    volumes = None if factor is None else checked("factor", factor, "f8", shape)
    if volumes is not None and volumes.size and volumes.min() < 0.0:
        raise ValueError(f"factor holds {volumes.min():g}; needs volumes of droplets, 0 and more")
    return droplets, volumes


def _is_finite(array: FloatMap) -> bool:
    """Whether all values are finite. Their sum is not if one of them is not; a sum of large ones proves nothing."""
    with np.errstate(over="ignore", invalid="ignore"):
        total = array.sum()
    return bool(np.isfinite(total) or np.isfinite(array).all())


def first_cell(marks: NDArray[np.bool_]) -> tuple[int, ...]:
    """Index of the first cell marked."""
    return tuple(int(index) for index in np.argwhere(marks)[0])


_ELEMENTS: dict[np.dtype[Any], Any] = {
    np.dtype(np.float64): ctypes.c_double,
    np.dtype(np.int32): ctypes.c_int32,
    np.dtype(np.int64): ctypes.c_int64,
    np.dtype(np.uint16): ctypes.c_uint16,
    np.dtype(np.bool_): ctypes.c_uint8,
    np.dtype(np.uint8): ctypes.c_uint8,
}


def pointer(array: NDArray[Any]) -> Any:
    """For C the address of the first element of the array, which it keeps alive."""
    element = _ELEMENTS[array.dtype]
    if array.size and array.flags.writeable:
        return (element * 1).from_buffer(array)  # a quarter of the time of the general way
    return array.ctypes.data_as(ctypes.POINTER(element))
