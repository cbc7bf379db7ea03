"""Check arrays of a grid for the C kernels: complete, finite and in C order, or a clear error."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inkloop.component import FloatMap
from inkloop_lab.models.library import INTEGERS, REALS


def heights(values: ArrayLike, name: str = "height") -> FloatMap:
    """A copy of the heights of a grid (nx, ny) [m]. Raises ValueError."""
    found = np.array(values, dtype=np.float64, order="C")
    if found.ndim != 2 or found.size == 0:
        raise ValueError(f"{name} has shape {found.shape}; needs (nx, ny), at least one cell")
    if not np.isfinite(found).all():
        raise ValueError(
            f"{name} is not finite in {np.count_nonzero(~np.isfinite(found))} cells; needs a height in all"
        )
    return found


def pattern_of(values: ArrayLike, shape: tuple[int, int]) -> NDArray[np.int32]:
    """A pattern (nx, ny): 0 none, 1 material A, 2 material B. Raises ValueError."""
    found = np.asarray(values)
    if found.shape != shape:
        raise ValueError(f"pattern has shape {found.shape}; needs {shape}, that of the surface")
    if found.dtype.kind not in "biu":
        raise ValueError(f"pattern is {found.dtype}; needs whole numbers or booleans")
    wrong = np.argwhere((found < 0) | (found > 2))
    if wrong.size:
        i, j = (int(index) for index in wrong[0])
        raise ValueError(f"pattern is {found[i, j]} in cell ({i}, {j}); needs 0, 1 or 2")
    return np.ascontiguousarray(found, dtype=np.int32)


def volumes(values: ArrayLike | None, shape: tuple[int, int]) -> FloatMap:
    """Volume of each cell's droplet in nominal drops (nx, ny), all 1 if none are given. Raises ValueError."""
    if values is None:
        return np.ones(shape)
    found = np.array(values, dtype=np.float64, order="C")
    if found.shape != shape or not (np.isfinite(found) & (found >= 0.0)).all():
        raise ValueError(f"volume has shape {found.shape}; needs {shape}, all finite and at least 0")
    return found


def positive(**lengths: float) -> None:
    """Raises ValueError with every number that is not above 0."""
    wrong = [
        f"{name} is {value!r}; needs a number above 0" for name, value in lengths.items() if not 0 < value < np.inf
    ]
    if wrong:
        raise ValueError("; ".join(wrong))


def passes_of(passes: int, pass_order: int, pass_rotation: int) -> None:
    """Raises ValueError for an invalid number of passes."""
    if passes not in (1, 4) or pass_order not in (1, 2) or not 0 <= pass_rotation <= 3:
        raise ValueError(
            f"passes is {passes}, pass_order {pass_order}, pass_rotation {pass_rotation}; needs 1 or 4 passes in order "
            "1 (raster) or 2 (diagonal), rotated by 0 to 3 places"
        )


def reals(values: NDArray[np.float64]) -> Any:
    """Pointer to the numbers of a C-ordered array."""
    return values.ctypes.data_as(REALS)


def integers(values: NDArray[np.int32]) -> Any:
    """Pointer to the numbers of a C-ordered array."""
    return values.ctypes.data_as(INTEGERS)
