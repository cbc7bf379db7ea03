"""Overhangs: intervals of a part without support, where droplets would fall on the material or substrate below."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inkloop.geometry.columns import Columns

GAP_M = 1e-7
"""Largest negligible gap: far below any droplet, far above the rounding of a mesh in single precision (assumed)."""
_SUBSTRATE = 0.0  # [m]


@dataclass(frozen=True)
class Overhangs:
    """Cells where a part has an interval that rests neither on the substrate nor on the part itself.

    cells: their number; share: of the part's cells; first: (i, j) of the first one; bottom: height of its lowest
    overhang [m]; tallest: the largest gap below any of them [m].
    """

    cells: int
    share: float
    first: tuple[int, int]
    bottom: float
    tallest: float


def overhangs(part: Columns) -> Overhangs | None:
    """The overhangs of a part on the substrate, z = 0; None where every interval rests on something."""
    part = _solid(part)
    if not (part.bottoms > _SUBSTRATE).any():
        return None
    below = _below(part)
    cells, hangs = part.cells, part.bottoms > below
    if not hangs.any():
        return None
    number, first = int(np.count_nonzero(np.bincount(cells[hangs]))), int(np.argmax(hangs))
    return Overhangs(
        cells=number,
        share=number / int(part.mask.sum()),
        first=divmod(int(cells[first]), part.ny),
        bottom=float(part.bottoms[first]),
        tallest=float((part.bottoms - below).max()),
    )


def resting(part: Columns) -> Columns:
    """Intervals that can be printed without support: on each cell the one that rests on the substrate, if any."""
    part = _solid(part)
    kept = part.bottoms == _SUBSTRATE
    if kept.all():
        return part
    cells, bottoms, tops = part.cells[kept], part.bottoms[kept], part.tops[kept]
    return Columns.of_intervals(part.nx, part.ny, part.pitch, cells, bottoms, tops)


def support_below(part: Columns) -> Columns:
    """Support of the overhangs: from the substrate, or from the part below, up to each of them."""
    part = _solid(part)
    return Columns.of_intervals(part.nx, part.ny, part.pitch, part.cells, _below(part), part.bottoms)


def _solid(part: Columns) -> Columns:
    """The part over the substrate, with negligible gaps closed."""
    above = part.tops > _SUBSTRATE
    if above.all() and (part.bottoms == _SUBSTRATE).all():
        return part
    cells, tops = part.cells[above], part.tops[above]
    bottoms = np.where(part.bottoms[above] <= GAP_M, _SUBSTRATE, part.bottoms[above])
    joined = (cells[1:] == cells[:-1]) & (bottoms[1:] - tops[:-1] <= GAP_M)
    bottoms[1:] = np.where(joined, tops[:-1], bottoms[1:])
    return Columns.of_intervals(part.nx, part.ny, part.pitch, cells, bottoms, tops)


def _below(part: Columns) -> NDArray[np.float64]:
    """End of the part below each interval, or the substrate [m]."""
    below = np.full(part.bottoms.size, _SUBSTRATE)
    is_above = part.cells[1:] == part.cells[:-1]
    below[1:][is_above] = part.tops[:-1][is_above]
    return below
