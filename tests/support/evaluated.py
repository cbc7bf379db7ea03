"""Surfaces to evaluate, and all of their areal parameters."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from inkloop.metrology.evaluation.definitions import Treatment
from inkloop.metrology.evaluation.subject import Subject
from inkloop.metrology.evaluation.surface import Found, Refusal, Surface, evaluated
from inkloop.metrology.evaluation.table import found
from inkloop.metrology.height_map import HeightMap

A, STEP, PERIOD = 2e-6, 1e-5, 40
"""Amplitude [m] and cells of a sinusoid, and the pitch [m]."""
Map = NDArray[Any]


def map_of(z: Map, dx: float = STEP, dy: float = STEP) -> HeightMap:
    return HeightMap(z, dx, dy, source="test")


def wave(cells: int = 2 * PERIOD, rows: int = 11) -> Map:
    """A sinusoid along x."""
    return np.repeat(A * np.sin(2 * pi * np.arange(cells) / PERIOD)[:, None], rows, axis=1)


def rough(shape: tuple[int, int] = (24, 17)) -> Map:
    """Heights that are correlated along x only."""
    return np.random.default_rng(2).normal(0.0, 3e-6, shape).cumsum(axis=0)


def texture(sigma: tuple[float, float], shape: tuple[int, int] = (256, 256), seed: int = 3) -> Map:
    """White noise under a Gaussian filter: f(t) = exp(-(t_x / 2 sigma_x)^2 - (t_y / 2 sigma_y)^2)."""
    from scipy.ndimage import gaussian_filter

    return np.asarray(A * gaussian_filter(np.random.default_rng(seed).normal(size=shape), sigma, mode="wrap"))


def surface_of(map_: HeightMap, mask: Map | None = None, **treatment: Any) -> Surface:
    surface = evaluated(map_, mask, Treatment(**treatment))
    assert isinstance(surface, Surface), surface
    return surface


def areal(map_: HeightMap, mask: Map | None = None, **treatment: Any) -> Found:
    """All parameters of the group."""
    return found(Subject(map_, mask), "areal", Treatment(**treatment))


def number(values: Found, symbol: str) -> float:
    """The value of a parameter, which must have one."""
    value = values[symbol]
    assert not isinstance(value, Refusal), f"{symbol}: {value.reason}"
    return value


def check(values: Found, expected: Mapping[str, float], rel: float = 1e-12, abs: float = 0.0) -> None:
    """The values of these parameters."""
    assert {symbol: number(values, symbol) for symbol in expected} == pytest.approx(dict(expected), rel=rel, abs=abs)


def reason(values: Found, symbol: str) -> str:
    """The reason why a parameter has no value."""
    value = values[symbol]
    assert isinstance(value, Refusal), f"{symbol} is {value}"
    return value.reason


def check_same(one: Found, other: Found, factors: Mapping[str, float] | None = None, rel: float = 1e-9) -> None:
    """The same values, times the factors, and the same parameters refused."""
    assert one.keys() == other.keys()
    for symbol, value in one.items():
        if isinstance(value, Refusal):
            assert isinstance(other[symbol], Refusal), symbol
        else:
            expected = number(other, symbol) * (factors or {}).get(symbol, 1.0)
            assert value == pytest.approx(expected, rel=rel, abs=1e-22), symbol
