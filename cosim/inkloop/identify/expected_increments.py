"""What the droplets of a layer are expected to add on a surface that is known with an error.

A neighbour's share clip(1 + rise / width, 0, 1) bends, so that the share at the measured rise is not the mean of the
shares at the rises that may have been: on a flat surface with noise it is too small. Its mean over a normal rise is
known in closed form, and regressed on that mean the growth is unbiased (regression calibration; Carroll et al. 2006,
"Measurement error in nonlinear models", chapter 4).
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
    share = np.clip(1.0 + rise / width, 0.0, 1.0)
    unsure = variance > (1e-12 * width) ** 2
    if unsure.any():
        r, w, spread = rise[unsure], width[unsure], np.sqrt(variance[unsure])
        share[unsure] = np.clip((_above_zero(r + w, spread) - _above_zero(r, spread)) / w, 0.0, 1.0)
    return share


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
    """Growth per metre of each height of each material, and the sum of the squares of what the droplets add.

    height, variance: (nx, ny) of the surface before the layer [m], [m^2]; heights: (materials, 3, 6 or 10) as in
    `inkloop.models.LayerDeposition`, which give the widths; colours: of the passes. Returns (materials, heights, nx,
    ny) [1], with which the growth is linear in the heights, and (nx, ny) [m^2]. Without variance this is the layer map
    itself (Lu, Zheng, Mishra 2015, equations 3 to 7).
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
    padded, padded_variance = np.pad(height, reach), np.pad(variance, reach)
    rates = np.zeros((materials, count, nx + 2 * reach, ny + 2 * reach))
    squares, kept = np.zeros(padded.shape), np.zeros((count, i.size))
    kept[0] = 1.0
    for di in range(-reach, reach + 1):
        for dj in range(-reach, reach + 1):
            if di == dj == 0:
                continue
            far, near = max(abs(di), abs(dj)), min(abs(di), abs(dj))
            kind = far * (far + 1) // 2 + near
            there = (i + di + reach, j + dj + reach)
            width = np.maximum(own[0] + own[kind], NO_WIDTH)
            share = expected_share(height[i, j] - padded[there], variance[i, j] + padded_variance[there], width)
            is_edge = (i + di < 0) | (i + di >= nx) | (j + dj < 0) | (j + dj >= ny)
            share[is_edge] = 1.0
            kept[kind] += 1.0 - share
            squares[there] += (share * own[kind]) ** 2  # a neighbour has one droplet at this place of its own
            rates[(material, kind, *there)] += share
    middle = (i + reach, j + reach)
    for kind in range(count):
        rates[(material, kind, *middle)] += kept[kind]
    squares[middle] += np.sum(own * kept, axis=0) ** 2
    here = np.s_[reach : reach + nx, reach : reach + ny]
    return rates[(np.s_[:], np.s_[:], *here)], squares[here]
