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

_INV_SQRT_TWO_PI = 1.0 / np.sqrt(2.0 * np.pi)


def expected_share(rise: FloatMap, variance: FloatMap, width: FloatMap) -> FloatMap:
    """Mean of clip(1 + r / width, 0, 1) over r ~ N(rise, variance); all of one shape [m], [m^2], [m]."""
    spread = np.sqrt(variance)
    known = spread < 1e-12 * width
    safe = np.where(known, 1.0, spread)

    def above_zero(mean: FloatMap) -> FloatMap:
        """Mean of max(r, 0)."""
        at = mean / safe
        return np.asarray(mean * ndtr(at) + safe * _INV_SQRT_TWO_PI * np.exp(-0.5 * at**2))

    unsure = (above_zero(rise + width) - above_zero(rise)) / width
    return np.clip(np.where(known, 1.0 + rise / width, unsure), 0.0, 1.0)


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
    own = 2 * (np.arange(nx)[:, None] % 2) + np.arange(ny) % 2
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
    table = np.vstack([np.ones(count), heights])  # the first row stands for no droplet, its widths are never used
    padded = np.pad(height, reach)
    padded_variance = np.pad(variance, reach)
    inside = np.pad(np.ones((nx, ny), np.bool_), reach)
    rates = np.zeros((materials, count, nx + 2 * reach, ny + 2 * reach))
    squares, kept = np.zeros(inside.shape), np.zeros((count, nx, ny))
    kept[0] = pattern > 0
    here = np.s_[reach : reach + nx, reach : reach + ny]
    for di in range(-reach, reach + 1):
        for dj in range(-reach, reach + 1):
            if di == dj == 0:
                continue
            far, near = max(abs(di), abs(dj)), min(abs(di), abs(dj))
            kind = far * (far + 1) // 2 + near
            there = np.s_[reach + di : reach + di + nx, reach + dj : reach + dj + ny]
            spread = table[pattern, kind]
            width = np.maximum(table[pattern, 0] + spread, 1e-30)
            share = expected_share(height - padded[there], variance + padded_variance[there], width)
            share = np.where(pattern > 0, np.where(inside[there], share, 1.0), 0.0)
            kept[kind] += np.where(pattern > 0, 1.0 - share, 0.0)
            squares[there] += (share * spread) ** 2
            for material in range(materials):
                rates[(material, kind, *there)] += np.where(pattern == material + 1, share, 0.0)
    for material in range(materials):
        rates[(material, np.s_[:], *here)] += np.where(pattern == material + 1, kept, 0.0)
    own = np.where(pattern > 0, np.sum(np.moveaxis(table[pattern], -1, 0) * kept, axis=0), 0.0)
    squares[here] += own**2
    return rates[(np.s_[:], np.s_[:], *here)], squares[here]
