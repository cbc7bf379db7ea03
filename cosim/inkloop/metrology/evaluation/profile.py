"""Profile parameters of ISO 21920-2 on the rows of a map.

A profile is the longest piece of a row without a gap. Without an L-filter it is a primary profile, and the parameters
are those of the P-profile; with one it is a roughness profile with section lengths as long as the cutoff. Filters act
along the row (ISO 16610-21), the F-operation on the whole surface. Each value is the mean over the profiles.

    Pa, Ra = mean of |z|      Pq, Rq = sqrt(mean of z^2)     over the evaluation length
    Pt, Rt = largest minus smallest z over the evaluation length
    Pp = max z      Pv = -min z                              over the evaluation length
    Rp, Rv = mean over the sections of their max z, -min z   Rz = Rp + Rv

Evaluation length: of a primary profile the median length of the pieces, so that at least half of the rows hold it; of a
roughness profile five section lengths, or as many as the longest piece holds. Rows that do not hold it are left out,
the others are evaluated in their middle. Heights of a primary profile are counted from their mean.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inkloop.metrology.evaluation.definitions import Axis
from inkloop.metrology.evaluation.surface import Found, Surface, refused
from inkloop.units import UM_PER_M

CELLS_MIN = 10
"""Cells of a profile (assumed)."""
SECTIONS = 5
"""Section lengths in an evaluation length (default of ISO 21920-3)."""
PRIMARY = ("Pa", "Pq", "Pp", "Pv", "Pt")
ROUGHNESS = ("Ra", "Rq", "Rp", "Rv", "Rz", "Rt")


@dataclass(frozen=True)
class Profiles:
    """The profiles evaluated; evaluation and section length [m], `sections` 0 for primary profiles."""

    axis: Axis
    count: int
    rows: int
    length: float
    sections: int

    def __str__(self) -> str:
        parts = f", {self.sections} section lengths" if self.sections else ", primary profiles"
        return (
            f"{self.count} of {self.rows} rows along {self.axis}, "
            f"evaluation length {self.length * UM_PER_M:.4g} µm{parts}"
        )


def profile_parameters(surface: Surface, axis: Axis, l_filter: float | None = None) -> tuple[Found, Profiles | None]:
    """The P-parameters, or with an L-filter [m] the R-parameters, and their profiles.

    surface: as `evaluated` returns it for this axis.
    """
    symbols = PRIMARY if l_filter is None else ROUGHNESS
    step = surface.dx if axis == "x" else surface.dy
    pieces = _pieces(surface, axis)
    longest = max(piece.size for piece in pieces)
    if l_filter is None:
        cells, sections = int(np.median([piece.size for piece in pieces])), 0
    else:
        section = round(l_filter / step)
        sections = min(SECTIONS, longest // section)
        cells = sections * section
    if cells < CELLS_MIN:
        text = f"the longest gap-free piece of a row has {longest} cells, too few for an evaluation length"
        if l_filter is None:
            text = f"half of the rows have less than {CELLS_MIN} cells in a row with heights"
        return refused(symbols, text), None
    kept = [piece for piece in pieces if piece.size >= cells]
    z = np.stack([piece[(piece.size - cells) // 2 :][:cells] for piece in kept])
    profiles = Profiles(axis, len(kept), len(pieces), cells * step, sections)
    return (_primary(z) if l_filter is None else _roughness(z, sections)), profiles


def _primary(z: NDArray[np.float64]) -> dict[str, float]:
    """z: (profiles, cells)."""
    z = z - z.mean(axis=1, keepdims=True)
    common = _common("P", z)
    return {**common, "Pp": float(z.max(axis=1).mean()), "Pv": float(-z.min(axis=1).mean())}


def _roughness(z: NDArray[np.float64], sections: int) -> dict[str, float]:
    parts = z.reshape(z.shape[0], sections, -1)
    rp, rv = float(parts.max(axis=2).mean()), float(-parts.min(axis=2).mean())
    return {**_common("R", z), "Rp": rp, "Rv": rv, "Rz": rp + rv}


def _common(letter: str, z: NDArray[np.float64]) -> dict[str, float]:
    return {
        f"{letter}a": float(np.abs(z).mean(axis=1).mean()),
        f"{letter}q": float(np.sqrt((z**2).mean(axis=1)).mean()),
        f"{letter}t": float(np.ptp(z, axis=1).mean()),
    }


def _pieces(surface: Surface, axis: Axis) -> list[NDArray[np.float64]]:
    """The longest piece without a gap of each row that has a cell."""
    z, used = (surface.z.T, surface.used.T) if axis == "x" else (surface.z, surface.used)
    found = []
    for heights, cells in zip(z, used, strict=True):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], cells.astype(np.int8), [0]]))).reshape(-1, 2)
        if edges.size:
            first, end = edges[np.argmax(edges[:, 1] - edges[:, 0])]
            found.append(heights[first:end])
    return found
