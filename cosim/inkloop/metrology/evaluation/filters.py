"""Gaussian filters on masked maps (ISO 16610-61 for surfaces, 16610-21 for profiles) as local regression.

The weight of a lag t is exp(-pi (t / (alpha cutoff))^2) with alpha = sqrt(ln 2 / pi), so that a wave as long as the
cutoff keeps half of its amplitude; weights end at one cutoff, where they are below 1e-6. The smooth height of a cell is
the constant term of the polynomial of order 0 (a weighted mean) or 1 (a weighted plane) that fits the used cells around
it best. Cells that do not count have no weight: order 0 keeps constants, order 1 keeps planes, up to every edge and
hole.
"""

from __future__ import annotations

from collections.abc import Callable
from math import ceil, log, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap, FloatMap
from inkloop.metrology.evaluation.definitions import Axis, FilterOrder
from inkloop.units import UM_PER_M

ALPHA = sqrt(log(2.0) / pi)
STEPS_MIN = 4
"""Steps in a cutoff, from which on the sampled weights pass half of a wave of that length (to 0.4 %)."""
_RIDGE = 1e-11
"""Share of the second moments: if the used cells lie on one line, the slope across it is taken as zero."""


def cutoff_error(used: BoolMap, steps: tuple[float, float], cutoff: float, axis: Axis | None = None) -> str | None:
    """The reason why a cutoff [m] does not fit the cells that count, along one axis or both."""
    axes = (0, 1) if axis is None else ("xy".index(axis),)
    narrowest = min((np.ptp(np.nonzero(used)[axis]) + 1) * steps[axis] for axis in axes)
    widest_step, text = max(steps[axis] for axis in axes), f"a filter of {cutoff * UM_PER_M:g} µm"
    if not cutoff >= STEPS_MIN * widest_step * (1.0 - 1e-9):
        return f"{text} is narrower than {STEPS_MIN} cells of {widest_step * UM_PER_M:g} µm, which cannot sample it"
    if cutoff > narrowest:
        return f"{text} is wider than the cells that count, {narrowest * UM_PER_M:g} µm"
    return None


def gaussian(
    z: FloatMap,
    used: BoolMap,
    steps: tuple[float, float],
    cutoff: float,
    *,
    order: FilterOrder = 1,
    axis: Axis | None = None,
) -> FloatMap:
    """The smooth surface (m, n) of the heights z on the used cells, 0 elsewhere.

    steps: dx, dy [m]; cutoff [m]; axis: smooth along this one only.
    """
    axes = (0, 1) if axis is None else ("xy".index(axis),)
    lags = [_lags(steps[k], cutoff) if k in axes else np.zeros(1) for k in (0, 1)]
    moment = _Moments(used, lags)
    middle = float(z[used].mean())
    heights, weights = moment.of(np.where(used, z - middle, 0.0)), moment.of(used.astype(np.float64))
    total, mean = weights(0, 0), heights(0, 0)
    if order == 1:
        powers = [((1, 0), (0, 1))[k] for k in axes]
        first = [weights(*p) for p in powers]
        slope = [heights(*p) for p in powers]
        second = {(a, b): weights(*np.add(powers[a], powers[b])) for a in range(len(axes)) for b in range(a + 1)}
        total, mean = _reduced(total, mean, first, slope, second)
    smooth = np.zeros_like(z)
    smooth[used] = mean / total + middle
    return smooth


def _lags(step: float, cutoff: float) -> NDArray[np.float64]:
    """Lags in cutoffs, up to one cutoff on both sides."""
    half = ceil(cutoff / step)
    return np.asarray(np.arange(-half, half + 1) * (step / cutoff), np.float64)


class _Moments:
    """Sums of weight u^a v^b times a map around each used cell, u and v the lags in cutoffs; by FFT, unwrapped."""

    def __init__(self, used: BoolMap, lags: list[NDArray[np.float64]]) -> None:
        from scipy.fft import next_fast_len

        self._used, self._lags = used, lags
        self._size = [next_fast_len(n + lag.size // 2, real=True) for n, lag in zip(used.shape, lags, strict=True)]

    def of(self, values: FloatMap) -> Callable[[int, int], NDArray[np.float64]]:
        """(a, b) -> the sums over one map, (N,)."""
        from scipy.fft import fft, irfft2, rfft, rfft2

        spectrum = rfft2(values, self._size)

        def sums(a: int, b: int) -> NDArray[np.float64]:
            kernel = fft(self._kernel(0, a))[:, None] * rfft(self._kernel(1, b))
            found = irfft2(spectrum * kernel, self._size)[: self._used.shape[0], : self._used.shape[1]]
            return np.asarray(found[self._used], np.float64)

        return sums

    def _kernel(self, axis: int, power: int) -> NDArray[np.float64]:
        """Weights in the layout of a cyclic convolution, which finds the neighbour at a lag in reverse."""
        lag, kernel = self._lags[axis], np.zeros(self._size[axis])
        half = lag.size // 2
        weights = np.exp(-pi * (lag / ALPHA) ** 2) * lag**power
        np.add.at(kernel, -np.arange(-half, half + 1) % self._size[axis], weights)
        return kernel


def _reduced(
    total: NDArray[np.float64],
    mean: NDArray[np.float64],
    first: list[NDArray[np.float64]],
    slope: list[NDArray[np.float64]],
    second: dict[tuple[int, int], NDArray[np.float64]],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The normal equations of a plane with its slopes eliminated: the remaining equation determines the constant
    term.
    """
    ridge = _RIDGE * total
    xx = second[0, 0] + ridge
    if len(first) == 1:
        ratio = first[0] / xx
        return total - ratio * first[0], mean - ratio * slope[0]
    xy, yy = second[1, 0], second[1, 1] + ridge
    determinant = xx * yy - xy * xy
    by_x = (yy * first[0] - xy * first[1]) / determinant
    by_y = (xx * first[1] - xy * first[0]) / determinant
    return total - by_x * first[0] - by_y * first[1], mean - by_x * slope[0] - by_y * slope[1]
