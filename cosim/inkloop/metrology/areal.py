"""Areal surface texture (ISO 25178-2) of a map with holes: no height is invented where none was measured.

Heights z are those of the N cells that count, after the F-operation, each of the same area. Gradients live on the
squares between four such neighbours (i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1): each is divided into two triangles
in both of its ways, so that the result does not depend on the direction of a diagonal.

    Sa = sum |z| / N            Sq = sqrt(sum z^2 / N)      Sp = max z       Sv = -min z      Sz = Sp + Sv
    Ssk = sum z^3 / (N Sq^3)    Sku = sum z^4 / (N Sq^4)
    Sdq = sqrt(mean of |grad z|^2 over the triangles)
    Sdr = mean of sqrt(1 + |grad z|^2) - 1 over the triangles
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from math import isclose, nan
from typing import Literal, TypeAlias

import numpy as np

from inkloop.component import BoolMap, FloatMap
from inkloop.errors import HeightMapError
from inkloop.metrology.height_map import HeightMap

FOperation: TypeAlias = Literal["mean", "plane"]
CELLS_MIN = 50
MISSING_MAX = 0.2
"""Share of cells without a height beyond which no figure is given (assumed)."""
_FLAT = 1e-12
"""Of the range of heights before the F-operation: what is left below it is rounding, and has no shape."""


@dataclass(frozen=True)
class Areal:
    """Sa, Sq, Sp, Sv, Sz [m]; Ssk, Sku, Sdq, Sdr [1]; NaN where not defined: Ssk, Sku of a flat surface, Sdq, Sdr
    without a square.

    cells: that count; missing: cells of the mask without a height.
    """

    Sa: float
    Sq: float
    Sp: float
    Sv: float
    Sz: float
    Ssk: float
    Sku: float
    Sdq: float
    Sdr: float
    cells: int
    missing: int


LENGTHS = ("Sa", "Sq", "Sp", "Sv", "Sz")
NAMES: Mapping[str, str] = {
    "Sa": "arithmetical mean height",
    "Sq": "root mean square height",
    "Sp": "maximum peak height",
    "Sv": "maximum pit depth",
    "Sz": "maximum height",
    "Ssk": "skewness",
    "Sku": "kurtosis",
    "Sdq": "root mean square gradient",
    "Sdr": "developed interfacial area ratio",
}
"""Parameters of ISO 25178-2 by symbol."""


def areal(map_: HeightMap, mask: BoolMap | None = None, f_operation: FOperation = "plane") -> Areal:
    """The parameters over the cells of `mask` (None: all) that have a height.

    Raises HeightMapError for a mask of another shape, fewer than CELLS_MIN cells, more than MISSING_MAX of them without
    a height, or cells on one line, which define no plane.
    """
    asked = np.ones(map_.shape, np.bool_) if mask is None else mask
    if asked.shape != map_.shape:
        raise HeightMapError(f"{map_.source}: has {map_.shape} cells, its mask {asked.shape}; give a mask of its shape")
    used = asked & map_.valid
    count, missing = int(used.sum()), int((asked & ~map_.valid).sum())
    if count < CELLS_MIN:
        raise HeightMapError(
            f"{map_.source}: {count} cells have a height; needs {CELLS_MIN}: take a larger mask or map"
        )
    if missing > MISSING_MAX * (count + missing):
        raise HeightMapError(
            f"{map_.source}: {missing} of {count + missing} cells have no height; at most {MISSING_MAX:.0%} may "
            "lack one: take a smaller mask, or measure again"
        )
    z = _without_form(map_, used, f_operation)
    heights = z[used]
    before = float(np.ptp(map_.z[used]))
    if isclose(before, before + float(np.abs(heights).max()), rel_tol=_FLAT):
        heights = np.zeros_like(heights)
    sq = float(np.sqrt(np.mean(heights**2)))
    slope, ratio = _gradients(z, used, map_.dx, map_.dy)
    return Areal(
        Sa=float(np.mean(np.abs(heights))),
        Sq=sq,
        Sp=float(heights.max()),
        Sv=float(-heights.min()),
        Sz=float(np.ptp(heights)),
        Ssk=float(np.mean((heights / sq) ** 3)) if sq > 0.0 else nan,
        Sku=float(np.mean((heights / sq) ** 4)) if sq > 0.0 else nan,
        Sdq=slope,
        Sdr=ratio,
        cells=count,
        missing=missing,
    )


def values(result: Areal) -> dict[str, float]:
    """The parameters by symbol, in SI."""
    return {field.name: getattr(result, field.name) for field in fields(result) if field.name in NAMES}


def _without_form(map_: HeightMap, used: BoolMap, f_operation: FOperation) -> FloatMap:
    """Heights less their mean or plane over the used cells (least squares, vertical distances)."""
    z = np.asarray(map_.z - map_.z[used].mean(), np.float64)
    if f_operation == "mean":
        return z
    i, j = (index - index[used].mean() for index in np.indices(map_.shape).astype(np.float64))
    terms = np.stack([i, j], axis=-1)
    slopes, _, rank, _ = np.linalg.lstsq(terms[used], z[used], rcond=None)
    if rank < terms.shape[-1]:
        raise HeightMapError(f"{map_.source}: its cells lie on one line and define no plane; take the mean off only")
    return np.asarray(z - terms @ slopes, np.float64)


def _gradients(z: FloatMap, used: BoolMap, dx: float, dy: float) -> tuple[float, float]:
    """Sdq and Sdr."""
    whole = used[:-1, :-1] & used[1:, :-1] & used[:-1, 1:] & used[1:, 1:]
    if not whole.any():
        return nan, nan
    along_x, along_y = np.diff(z, axis=0) / dx, np.diff(z, axis=1) / dy
    by_x = [along_x[:, :-1][whole], along_x[:, 1:][whole]]
    by_y = [along_y[:-1][whole], along_y[1:][whole]]
    squares = np.array([x**2 + y**2 for x in by_x for y in by_y])  # of the four triangles' gradients
    return float(np.sqrt(squares.mean())), float(np.mean(squares / (np.sqrt(1.0 + squares) + 1.0)))
