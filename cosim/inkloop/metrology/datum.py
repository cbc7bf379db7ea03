"""Levelling of a scan: many profilers lose height and tilt between scans, cells outside the part keep it."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from inkloop.component import BoolMap, FloatMap
from inkloop.errors import HeightMapError

__all__ = ["Datum", "level", "reference_cells"]

Datum: TypeAlias = Literal["none", "offset", "plane"]

CELLS_MIN = {"none": 0, "offset": 1, "plane": 8}
CLIP = 3.0  # standard deviations beyond which a reference cell is left out: dirt, satellite droplets (assumed)
_NORMAL = 1.4826  # standard deviation of a normal distribution over its median absolute deviation
_ROUNDS = 5


def reference_cells(mask: BoolMap, margin: int) -> BoolMap:
    """Cells more than `margin` cells away from the part, where no droplet reaches."""
    near = mask.copy()
    for _ in range(margin):
        padded = np.pad(near, 1)
        near = np.logical_or.reduce(
            [padded[i : i + near.shape[0], j : j + near.shape[1]] for i in range(3) for j in range(3)]
        )
    return ~near


def level(height: FloatMap, reference: BoolMap, datum: Datum) -> FloatMap:
    """The surface (nx, ny) [m] less the offset or the plane of its reference cells; NaN stays NaN.

    The offset is their median, the plane a least-squares fit without outliers. Raises HeightMapError if too few
    reference cells were measured, or all of them on one line.
    """
    if datum == "none":
        return height
    used = reference & np.isfinite(height)
    if np.count_nonzero(used) < CELLS_MIN[datum]:
        raise HeightMapError(
            f"datum: {np.count_nonzero(used)} cells outside the part were measured, the {datum} needs "
            f"{CELLS_MIN[datum]}; scan a wider field, enlarge the grid around the part, or set datum = 'none'"
        )
    if datum == "offset":
        return height - np.median(height[used])
    return height - plane(height, used)[0]


def plane(height: FloatMap, reference: BoolMap) -> tuple[FloatMap, BoolMap]:
    """The least-squares plane (nx, ny) [m] of the reference cells, and those of them that are no outliers.

    Raises HeightMapError if all of them lie on one line.
    """
    used = reference
    i, j = np.indices(height.shape)
    terms = np.stack([np.ones(height.shape), i / height.shape[0], j / height.shape[1]], axis=-1)
    for _ in range(_ROUNDS):
        factors, _, rank, _ = np.linalg.lstsq(terms[used], height[used], rcond=1e-6)
        if rank < terms.shape[-1]:
            raise HeightMapError("datum: the measured cells outside the part lie on one line and define no plane")
        distance = np.abs(height - terms @ factors)
        limit = CLIP * _NORMAL * float(np.median(distance[used]))
        kept = used & (distance <= max(limit, 1e-12))
        if np.count_nonzero(kept) < CELLS_MIN["plane"] or np.array_equal(kept, used):
            break
        used = kept
    return np.asarray(terms @ factors, np.float64), used
