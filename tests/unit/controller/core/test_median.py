"""The median is the middle of the sorted values, however many there are and however they lie."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from support.compiled import library
from support.places import ROOT

SOURCE = ROOT / "controller" / "core" / "problem" / "median.c"
FLAGS = ("-std=c11", "-O2", f"-I{ROOT / 'controller' / 'core' / 'problem'}", f"-I{ROOT / 'fmus' / 'deposition'}")
SAMPLED = 1024  # values; from here on limits are drawn from a sample (median.c)
CHUNKS = 32  # of the rows of a grid (row_ranges.h)
REALS = ctypes.POINTER(ctypes.c_double)

pytestmark = pytest.mark.compiled


def sample_size(count: int) -> int:
    """As in median.c, but for few values, of which all are looked at: 1."""
    sizes = [2**k for k in range(6, 12) if 8**k <= 2 * count**2]
    return sizes[-1] if count >= SAMPLED else 1


DRAWN: dict[str, Callable[[np.random.Generator, int], Any]] = {
    "normal": lambda rng, count: rng.normal(size=count),
    "ascending": lambda rng, count: np.sort(rng.normal(size=count)),
    "equal": lambda rng, count: np.full(count, 3e-6),
    "few values": lambda rng, count: rng.integers(0, 3, count).astype(float),
    "two heaps": lambda rng, count: np.where(np.arange(count) % 2 == 0, 1e-6, 2e-6) + 1e-9 * rng.normal(size=count),
    "a sample that misleads": lambda rng, count: (
        np.where(np.arange(count) % (count // sample_size(count)) == 0, 9.0, 1.0) * rng.random(count)
    ),
}


class ValueLists(ctypes.Structure):
    """`ValueLists` of median.h."""

    _fields_ = (("nx", ctypes.c_size_t), ("ny", ctypes.c_size_t), ("map", REALS), ("lengths", ctypes.c_size_t * CHUNKS))


@pytest.mark.parametrize("drawn", DRAWN)
def test_it_is_that_of_the_sorted_values(drawn: str) -> None:
    """Of an array, and of lists that chunks of rows left in a map, some of them empty."""
    core, rng = library("median.so", [SOURCE], FLAGS), np.random.default_rng(5)
    core.median.restype = core.median_of_lists.restype = ctypes.c_double
    for count in (1, 2, 3, 10, 11, SAMPLED - 1, SAMPLED, SAMPLED + 1, 8 * SAMPLED + 7, 100 * SAMPLED):
        values = DRAWN[drawn](rng, count)
        expected = np.sort(values)[(count - 1) // 2 : count // 2 + 1].mean()
        lists, room, _kept = listed(rng, values)
        assert core.median_of_lists(ctypes.byref(lists), room.ctypes.data_as(REALS)) == expected, count
        given = np.ascontiguousarray(values)
        assert core.median(given.ctypes.data_as(REALS), ctypes.c_size_t(count)) == expected, count


def listed(rng: np.random.Generator, values: Any) -> tuple[ValueLists, Any, Any]:
    """The values in lists of a map of 40 rows, room for as many, and the map; behind a list stand no numbers."""
    weights = rng.random(CHUNKS) * (rng.random(CHUNKS) < 0.7) + 1e-9
    ends = np.rint(np.cumsum(weights) / weights.sum() * len(values)).astype(int)
    nx, ny = 40, len(values)
    places = np.full((nx, ny), np.nan)
    lists = ValueLists(nx, ny, places.ctypes.data_as(REALS))
    for chunk, (begin, end) in enumerate(zip([0, *ends[:-1]], ends, strict=True)):
        places.reshape(-1)[nx * chunk // CHUNKS * ny :][: end - begin] = values[begin:end]
        lists.lengths[chunk] = end - begin
    return lists, np.empty_like(places), places
