"""h1, h2, h3 by the experiments of Lu, Zheng, Mishra (2015, section V-C): single droplets, a centre with four side
neighbours, a centre with one corner neighbour, each cured at once on flat ground, averaged over many.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve
from scipy.special import stdtrit

from inkloop.component import BoolMap
from inkloop_lab.identify.print_record import IdentificationError, PrintRecord
from inkloop_lab.identify.surface_filter import start_surface

SIDES = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]])
CORNERS = np.array([[1, 0, 1], [0, 0, 0], [1, 0, 1]])
RING = np.pad(np.zeros((3, 3), int), 1, constant_values=1)
NEIGHBOURS = {"single": (0, 0), "side": (4, 0), "corner": (0, 1)}
"""Motif -> droplets on the sides and on the corners of its centre; beyond them there are none within two cells."""
LEAST = 3  # samples of a motif, so that its mean has an error


@dataclass(frozen=True)
class ProtocolEstimate:
    """heights: h1, h2, h3 [m]; half_widths: of their 95 % confidence intervals [m]; counts: centres by motif."""

    heights: tuple[float, float, float]
    half_widths: tuple[float, float, float]
    counts: dict[str, int]


def identify_by_protocol(records: Sequence[PrintRecord], noise_std: float) -> ProtocolEstimate:
    """From the first layers of the prints, wherever the motifs occur in them. Raises IdentificationError.

    The height of a centre is what was measured there, over the start surface: the mean over the cell, or of its middle
    where the maps were read so.
    """
    found: dict[str, list[NDArray[np.float64]]] = {name: [] for name in NEIGHBOURS}
    for record in records:
        if len(record.pattern) == 0 or record.materials > 1:
            continue
        start, _ = start_surface(record.measured[0], noise_std)
        rise = record.measured[1] - start
        for name, centres in motif_centres(record.pattern[0]).items():
            found[name].append(rise[centres & np.isfinite(rise)])
    rises = {name: np.concatenate(parts) if parts else np.zeros(0) for name, parts in found.items()}
    counts = {name: int(values.size) for name, values in rises.items()}
    if min(counts.values()) < LEAST:
        counted = ", ".join(f"{count} {name}" for name, count in counts.items())
        raise IdentificationError(
            f"first layers hold {counted} motifs that stand alone; the protocol needs {LEAST} of each in one material"
        )
    mean = {name: float(values.mean()) for name, values in rises.items()}
    variance = {name: float(values.var(ddof=1)) / values.size for name, values in rises.items()}
    factor = float(stdtrit(min(counts.values()) - 1, 0.975))
    h1 = mean["single"]
    errors = (
        variance["single"],
        (variance["single"] + variance["side"]) / 16.0,
        variance["single"] + variance["corner"],
    )
    widths = tuple(factor * float(np.sqrt(error)) for error in errors)
    return ProtocolEstimate(
        (h1, (mean["side"] - h1) / 4.0, mean["corner"] - h1), (widths[0], widths[1], widths[2]), counts
    )


def motif_centres(pattern: NDArray[np.int32]) -> dict[str, BoolMap]:
    """By motif the cells (nx, ny) of a pattern that are its centre."""
    hit = (pattern > 0).astype(int)
    sides, corners, ring = (convolve(hit, kernel, mode="constant") for kernel in (SIDES, CORNERS, RING))
    alone = (hit > 0) & (ring == 0)
    return {name: alone & (sides == s) & (corners == c) for name, (s, c) in NEIGHBOURS.items()}
