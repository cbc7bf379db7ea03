"""Checks of arrays that a problem is given."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap


def error_of_array(name: str, array: NDArray[Any], dtype: str, shape: Sequence[int]) -> str | None:
    """The error of an array that must have this shape and dtype and finite values, or None."""
    error = error_of_layout(name, array, dtype, shape)
    if error:
        return error
    if dtype == "f8" and not is_finite(array):
        cell = first_cell(~np.isfinite(array))
        return f"{name} is {array[cell]} at cell {cell}; needs finite values"
    return None


def error_of_layout(name: str, array: NDArray[Any], dtype: str, shape: Sequence[int]) -> str | None:
    """The error of an array that must have this shape and dtype, or None."""
    if np.shape(array) != tuple(shape):
        return f"{name} has shape {np.shape(array)}; needs {tuple(shape)}"
    if array.dtype != np.dtype(dtype):
        return f"{name} has dtype {array.dtype}; needs {np.dtype(dtype)}"
    return None


def is_finite(array: FloatMap) -> bool:
    """Whether all values are finite. Their sum is not if one of them is not; a sum of large ones proves nothing."""
    with np.errstate(over="ignore", invalid="ignore"):
        total = array.sum()
    return bool(np.isfinite(total) or np.isfinite(array).all())


def first_cell(marks: NDArray[np.bool_]) -> tuple[int, ...]:
    """Index of the first cell marked."""
    return tuple(int(index) for index in np.argwhere(marks)[0])
