"""The errors of a print job and of a port. Most often a map has another shape, or heights are in micrometres."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from math import inf
from numbers import Integral
from typing import Any

import numpy as np

HEIGHT_MOST, INK_MOST, PITCH_LEAST = 0.4, 1e-3, 1e-9
"""Largest height, largest height of an ink, and least pitch [m], as LayerController.fmu has them."""
_NUMBERS = int | float | np.integer | np.floating


def errors_of_job(job: Any) -> list[str]:
    """The errors of a `Job`, a sentence each."""
    return [error for error in (*_errors_of_grid(job), *_errors_of_maps(job), *_errors_of_inks(job)) if error]


def errors_of_port(port: Any) -> list[str]:
    """The errors of a `Port`, a sentence each."""
    errors = [] if isinstance(port.name, str) and port.name else ["has no name"]
    is_shape = isinstance(port.shape, tuple) and all(isinstance(n, Integral) and int(n) >= 0 for n in port.shape)
    if not is_shape:
        errors.append(f"shape is {port.shape!r}; needs a tuple of lengths, () for a scalar")
    try:
        dtype = np.dtype(port.dtype) if isinstance(port.dtype, str | type | np.dtype) else None
    except (TypeError, SyntaxError):
        dtype = None
    if dtype is None or dtype.kind not in "biuf":
        return [
            *errors,
            f'dtype is {port.dtype!r}; needs the name of a type of numbers, like "float64", "int32", "bool"',
        ]
    try:
        start = np.asarray(port.start)
    except ValueError:  # lists of several lengths
        start = np.array(None)
    if start.dtype.kind not in "biuf":
        errors.append(f"start is {port.start!r}; needs a number, or an array of numbers")
    elif is_shape and not _fits(start.shape, port.shape):
        errors.append(f"start has shape {start.shape}; needs {port.shape}, or one number")
    elif dtype.kind != "f" and start.dtype != dtype:
        with np.errstate(invalid="ignore"):
            is_same = start.astype(dtype) == start
        if not is_same.all():
            wrong = start[~is_same].flat[0] if start.ndim else port.start
            errors.append(f"start is {wrong}; needs a value of {dtype}")
    return errors


def _fits(start: tuple[int, ...], shape: tuple[int, ...]) -> bool:
    """Whether an array of the shape `start` broadcasts to `shape`."""
    try:
        return np.broadcast_shapes(start, shape) == shape
    except ValueError:
        return False


def error_of_form(name: str, array: Any, dtype: str, shape: Sequence[int]) -> str:
    """The error of an array that must have this shape and dtype; "" if it has."""
    if not isinstance(array, np.ndarray):
        return f"{name} is a {type(array).__name__}; needs an array of {np.dtype(dtype)}"
    if array.shape != tuple(shape):
        return f"{name} has shape {array.shape}; needs {tuple(shape)}"
    return "" if array.dtype == np.dtype(dtype) else f"{name} has dtype {array.dtype}; needs {np.dtype(dtype)}"


def repeated(names: Iterable[str]) -> list[str]:
    """The names that occur more than once, in order."""
    return sorted(name for name, times in Counter(names).items() if times > 1)


def _errors_of_grid(job: Any) -> Iterator[str]:
    for name in ("nx", "ny"):
        if not isinstance(getattr(job, name), Integral) or getattr(job, name) < 1:
            yield f"{name} is {getattr(job, name)!r}; needs a number of cells"
    if not isinstance(job.pitch, _NUMBERS) or not PITCH_LEAST <= job.pitch < inf:
        yield f"pitch is {job.pitch!r}; needs a length of a cell in metres"
    if not isinstance(job.seed, Integral):
        yield f"seed is {job.seed!r}; needs a whole number"


def _errors_of_maps(job: Any) -> Iterator[str]:
    if not isinstance(job.nx, Integral) or not isinstance(job.ny, Integral):
        return
    shape = int(job.nx), int(job.ny)
    yield _error_of_heights("target_height", job.target_height, shape)
    yield error_of_form("mask", job.mask, "?", shape)
    if job.height_start is not None:
        yield _error_of_heights("height_start", job.height_start, shape)
    if job.region is not None and not hasattr(job.region, "intervals"):
        yield f"region is {job.region!r}; needs a Geometry, with its method intervals"


def _error_of_heights(name: str, found: Any, shape: tuple[int, int]) -> str:
    if error := error_of_form(name, found, "f8", shape):
        return error
    wrong = ~(np.abs(found) <= HEIGHT_MOST)
    if not wrong.any():
        return ""
    i, j = np.argwhere(wrong)[0]
    return f"{name} is {found[i, j]:g} at cell ({i}, {j}); needs heights in metres, within {HEIGHT_MOST:g} m"


def _errors_of_inks(job: Any) -> Iterator[str]:
    if not isinstance(job.inks, Sequence) or len(job.inks) not in (1, 2):
        yield f"inks is {job.inks!r}; needs one Ink or two"
        return
    for number, ink in enumerate(job.inks):
        for name in ("h1", "h2", "h3"):
            height = getattr(ink, name, None)
            if not isinstance(height, _NUMBERS) or not 0.0 <= height <= INK_MOST or (height == 0.0 and name == "h1"):
                least = "above 0" if name == "h1" else "from 0"
                yield f"inks[{number}].{name} is {height!r}; needs a height in metres, {least} to {INK_MOST:g} m"
