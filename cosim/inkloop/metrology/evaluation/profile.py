"""Profile parameters of ISO 21920-2 on the rows of a map.

A profile is the longest piece of a row without a gap. Without an L-filter it is a primary profile, and the parameters
are those of the P-profile; with one it is a roughness profile with section lengths as long as the cutoff. Filters act
along the row (ISO 16610-21), the F-operation on the whole surface. Each value is the mean over the profiles.

    Pa, Ra = mean of |z|      Pq, Rq = sqrt(mean of z^2)     over the evaluation length
    Pt, Rt = largest minus smallest z over the evaluation length
    Pp = max z      Pv = -min z                              over the evaluation length
    Rp, Rv = mean over the sections of their max z, -min z   Rz = Rp + Rv
    Psk, Rsk = mean of z^3 / q^3     Pku, Rku = mean of z^4 / q^4     q = Pq, Rq
    Psm, Rsm = mean length of the profile elements: a hill and the dale after it, or a dale and the hill after it. A
               hill reaches 10 % of Pp or Rp, a dale 10 % of Pv or Rv; between them z crosses 0, linear between points

Evaluation length: of a primary profile the median length of the pieces, so that at least half of the rows hold it; of a
roughness profile five section lengths, or as many as the longest piece holds. Rows that do not hold it are left out,
the others are evaluated in their middle. Heights of a primary profile are counted from their mean.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap
from inkloop.metrology.evaluation.definitions import Axis, symbols
from inkloop.metrology.evaluation.surface import Found, Refusal, Surface, refused
from inkloop.units import UM_PER_M

CELLS_MIN = 10
"""Cells of a profile (assumed)."""
SECTIONS = 5
"""Section lengths in an evaluation length (default of ISO 21920-3)."""
HEIGHT = 0.1
"""Share of Rp that a hill reaches, and of Rv that a dale does (default of ISO 21920-3)."""
PRIMARY, ROUGHNESS = (tuple(one for one in symbols("profile") if one.startswith(letter)) for letter in "PR")


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
    wanted = PRIMARY if l_filter is None else ROUGHNESS
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
        return refused(wanted, text), None
    kept = [piece for piece in pieces if piece.size >= cells]
    z = np.stack([piece[(piece.size - cells) // 2 :][:cells] for piece in kept])
    profiles = Profiles(axis, len(kept), len(pieces), cells * step, sections)
    letter, z = ("P", z - z.mean(axis=1, keepdims=True)) if l_filter is None else ("R", z)
    return _parameters(letter, z, sections, step), profiles


def _parameters(letter: str, z: FloatMap, sections: int, step: float) -> Found:
    """letter: "P" or "R"; z: (profiles, cells) [m]; sections: 0 of primary profiles."""
    parts = z.reshape(z.shape[0], max(1, sections), -1)
    peak, pit = parts.max(axis=2).mean(axis=1), -parts.min(axis=2).mean(axis=1)
    q = np.sqrt((z**2).mean(axis=1))
    found: dict[str, float | Refusal] = {
        "a": float(np.abs(z).mean()),
        "q": float(q.mean()),
        "p": float(peak.mean()),
        "v": float(pit.mean()),
        **({"z": float((peak + pit).mean())} if sections else {}),
        "t": float(np.ptp(z, axis=1).mean()),
    }
    if q.min() > 0.0:
        shape = z / q[:, None]
        found |= {"sk": float((shape**3).mean()), "ku": float((shape**4).mean())}
    else:
        found |= refused(("sk", "ku"), "a profile is flat, its heights have no distribution")
    lengths = [_elements(row, HEIGHT * top, HEIGHT * low) for row, top, low in zip(z, peak, pit, strict=True)]
    spacings = np.array([length.mean() for length in lengths if length.size]) * step
    none = Refusal("no profile has a hill and a dale between two crossings of its mean line")
    found["sm"] = float(spacings.mean()) if spacings.size else none
    return {letter + key: value for key, value in found.items()}


def _elements(z: NDArray[np.float64], hill: float, dale: float) -> NDArray[np.float64]:
    """Lengths of the profile elements [steps], from a crossing of 0 to the next but one.

    Between a hill and a dale the middle of the first and the last crossing counts: the mean of both directions.
    """
    outside = np.flatnonzero((z > max(hill, 0.0)) | (z < min(-dale, 0.0)))
    turns = np.flatnonzero(np.diff(z[outside] > 0.0))  # from a hill to a dale, or the reverse
    k = np.flatnonzero(np.diff(z > 0.0))
    places = k + z[k] / (z[k] - z[k + 1])
    first, last = np.searchsorted(k, outside[turns]), np.searchsorted(k, outside[turns + 1]) - 1
    crossings = (places[first] + places[last]) / 2.0
    return np.asarray(crossings[2:] - crossings[:-2], np.float64)


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
