"""Expected increments by the droplets of a layer on a surface that is known with an error.

A neighbour's share clip(1 + rise / width, 0, 1) is nonlinear, so the share at the measured rise is not the mean share
over the possible rises: on a flat surface with noise it is too small. Its mean over a normal rise is known in closed
form, and regressed on that mean the growth is unbiased (regression calibration; Carroll et al. 2006, "Measurement error
in nonlinear models", chapter 4).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from inkloop.component import FloatMap
from inkloop.contract import pass_colour

_INV_SQRT_TWO_PI = 1.0 / np.sqrt(2.0 * np.pi)
NO_WIDTH = 1e-30  # of an ink that adds nothing [m]: only keeps the quotient defined


def expected_share(rise: FloatMap, variance: FloatMap, width: FloatMap) -> FloatMap:
    """(n,): mean of clip(1 + r / width, 0, 1) over r ~ N(rise, variance); all (n,) [m], [m^2], [m]."""
    unsure = variance > (1e-12 * width) ** 2
    if unsure.all():
        return _normal_share(rise, variance, width)
    share = np.clip(1.0 + rise / width, 0.0, 1.0)
    if unsure.any():
        share[unsure] = _normal_share(rise[unsure], variance[unsure], width[unsure])
    return share


def _normal_share(rise: FloatMap, variance: FloatMap, width: FloatMap) -> FloatMap:
    """`expected_share` where the variance is more than rounding."""
    spread = np.sqrt(variance)
    return np.clip((_above_zero(rise + width, spread) - _above_zero(rise, spread)) / width, 0.0, 1.0)


def _above_zero(mean: FloatMap, spread: FloatMap) -> FloatMap:
    """Mean of max(r, 0) over r ~ N(mean, spread^2)."""
    at = mean / spread
    return np.asarray(mean * ndtr(at) + spread * _INV_SQRT_TWO_PI * np.exp(-0.5 * at**2))


def expected_rates(
    height: FloatMap,
    variance: FloatMap,
    pattern: NDArray[np.int32],
    heights: NDArray[np.float64],
    colours: Sequence[int] = (),
) -> tuple[NDArray[np.float64], FloatMap]:
    """Growth per metre of each height of each material, and the sum of the squared increments of the droplets.

    height, variance: (nx, ny) of the surface before the layer [m], [m^2]; heights: (materials, 3, 6 or 10) as in
    `models.LayerDeposition`, which give the widths; colours: of the passes. Returns (materials, heights, nx, ny) [1],
    with which the growth is linear in the heights, and (nx, ny) [m^2]. Without variance this is the layer map itself
    (Lu, Zheng, Mishra 2015, equations 3 to 7).
    """
    if not colours:
        return _rates_of_pass(height, variance, pattern, heights)
    nx, ny = height.shape
    own = pass_colour(*np.indices((nx, ny)))
    rates, squares = np.zeros((*heights.shape, nx, ny)), np.zeros((nx, ny))
    for colour in colours:
        found, spread = _rates_of_pass(height, variance, np.where(own == colour, pattern, 0), heights)
        rates, squares = rates + found, squares + spread
        height = height + np.tensordot(heights, found)
    return rates, squares


def _rates_of_pass(
    height: FloatMap, variance: FloatMap, pattern: NDArray[np.int32], heights: NDArray[np.float64]
) -> tuple[NDArray[np.float64], FloatMap]:
    nx, ny = height.shape
    materials, count = heights.shape
    reach = {3: 1, 6: 2, 10: 3}[count]
    i, j = np.nonzero(pattern)
    material = pattern[i, j] - 1
    own = heights[material].T  # (heights, droplets) [m]
    widths = np.maximum(own[0] + own, NO_WIDTH)
    here, here_variance = height[i, j], variance[i, j]
    padded, padded_variance = np.pad(height, reach), np.pad(variance, reach)
    is_outside = np.pad(np.zeros((nx, ny), np.bool_), reach, constant_values=True).ravel()
    rates = np.zeros((materials, count, *padded.shape))
    squares, kept = np.zeros(padded.size), np.zeros((count, i.size))
    kept[0] = 1.0
    # flat views: an index of one number costs a quarter of one of four
    row = padded.shape[1]
    middle, first = (i + reach) * row + j + reach, material * (count * padded.size)
    flat_height, flat_variance, flat_rates = padded.ravel(), padded_variance.ravel(), rates.ravel()
    for di in range(-reach, reach + 1):
        for dj in range(-reach, reach + 1):
            if di == dj == 0:
                continue
            far, near = max(abs(di), abs(dj)), min(abs(di), abs(dj))
            kind = far * (far + 1) // 2 + near
            there = middle + (di * row + dj)
            share = expected_share(here - flat_height[there], here_variance + flat_variance[there], widths[kind])
            share[is_outside[there]] = 1.0
            kept[kind] += 1.0 - share
            squares[there] += (share * own[kind]) ** 2  # a neighbour has one droplet at this place relative to it
            flat_rates[first + kind * padded.size + there] += share
    for kind in range(count):
        flat_rates[first + kind * padded.size + middle] += kept[kind]
    squares[middle] += np.sum(own * kept, axis=0) ** 2
    inner = np.s_[reach : reach + nx, reach : reach + ny]
    return rates[(np.s_[:], np.s_[:], *inner)], squares.reshape(padded.shape)[inner]
