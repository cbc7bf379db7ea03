"""The median of the estimator is the middle of the sorted values, however many there are and however they lie."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from support.compiled import library
from support.places import ROOT

SOURCE = ROOT / "controller" / "core" / "estimator" / "median.c"
SAMPLED = 8192  # from here on limits are drawn from a sample (median.c)

pytestmark = pytest.mark.compiled

DRAWN: dict[str, Callable[[np.random.Generator, int], Any]] = {
    "normal": lambda rng, count: rng.normal(size=count),
    "ascending": lambda rng, count: np.sort(rng.normal(size=count)),
    "equal": lambda rng, count: np.full(count, 3e-6),
    "few values": lambda rng, count: rng.integers(0, 3, count).astype(float),
    "two heaps": lambda rng, count: np.where(np.arange(count) % 2 == 0, 1e-6, 2e-6) + 1e-9 * rng.normal(size=count),
    "a sample that misleads": lambda rng, count: (
        np.where(np.arange(count) % (count // 2048 or 1) == 0, 9.0, 1.0) * rng.random(count)
    ),
}


@pytest.mark.parametrize("drawn", DRAWN)
def test_it_is_that_of_the_sorted_values(drawn: str) -> None:
    median = library("median.so", [SOURCE], ("-std=c11", "-O2")).median
    median.restype = ctypes.c_double
    rng = np.random.default_rng(5)
    for count in (1, 2, 3, 10, 11, SAMPLED - 1, SAMPLED, SAMPLED + 1, 5 * SAMPLED, 5 * SAMPLED + 7):
        values = DRAWN[drawn](rng, count)
        expected = np.sort(values)[(count - 1) // 2 : count // 2 + 1].mean()
        given = np.ascontiguousarray(values)
        assert median(given.ctypes.data_as(ctypes.POINTER(ctypes.c_double)), ctypes.c_size_t(count)) == expected, count
