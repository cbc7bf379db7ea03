"""Synthetic profiles of a profilometer around drops that fall on cured ones: the experiment of Wu and Chiu.

The paper prints no profiles. These come from its own model with its own coefficients, or from drops that rest under
surface tension, with random volumes and noise of the heights; both amounts are assumed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap
from inkloop_lab.identify.designs import PRIOR_MOTIFS, motif
from inkloop_lab.identify.print_record import PrintRecord
from inkloop_lab.models import VolumeAreaDeposition, YoungLaplaceDeposition
from inkloop_lab.models.volume_area_deposition import InkSurface
from inkloop_lab.models.young_laplace_deposition import FineSurface

PITCH, HEIGHT_SCALE, RADIUS = 90e-6, 7.0751e-6, 0.6 * 90e-6
"""Cell and c of the paper; the radius on flat ground that gives its equation 19."""
VARIATION, NOISE = 0.03, 0.04e-6
"""Standard deviation of the volume of a drop, assumed, and of a pixel: the resolution of the paper's profilometer."""
INKED = 0.2e-6
"""A pixel that is higher than this over the substrate counts as inked (assumed)."""
SIDE, PIXELS = 7, 16
Plant = VolumeAreaDeposition | YoungLaplaceDeposition


def liquid() -> YoungLaplaceDeposition:
    """The model of a drop of c d^2 that spreads over `RADIUS` on flat ground."""
    volume = HEIGHT_SCALE * PITCH**2
    height = _cap_height(volume)
    return YoungLaplaceDeposition(
        PITCH, volume, 2.0 * math.atan(height / RADIUS), form="linear", cells_per_pitch=PIXELS, passes=1
    )


def experiments(model: Plant, samples: int, seed: int = 0) -> Iterator[PrintRecord]:
    """`samples` prints of each pattern of prior drops: those one by one, each cured, then the last one."""
    rng = np.random.default_rng(seed)
    for drawing in PRIOR_MOTIFS.values():
        prior = np.pad(motif(drawing), (SIDE - 3) // 2)
        last = np.zeros_like(prior)
        last[SIDE // 2, SIDE // 2] = 1
        for _ in range(samples):
            yield _record(model, prior, last, rng)


def _record(model: Plant, prior: NDArray[np.int32], last: NDArray[np.int32], rng: np.random.Generator) -> PrintRecord:
    surface: FineSurface | InkSurface = model.start(np.zeros((SIDE, SIDE)))
    scans = [_measured(surface, rng)]
    for sites in (np.argwhere(prior), np.argwhere(last)):
        for i, j in sites:
            drop = np.zeros((SIDE, SIDE), dtype=np.int32)
            drop[i, j] = 1
            volume = np.full((SIDE, SIDE), max(0.1, 1.0 + VARIATION * rng.standard_normal()))
            surface = model.layer(surface, drop, volume=volume)  # type: ignore[arg-type]
        scans.append(_measured(surface, rng))
    heights, areas = (np.stack(maps) for maps in zip(*scans, strict=True))
    return PrintRecord("synthetic profiles", PITCH, np.stack([prior, last]), heights, area=areas)


def _measured(surface: FineSurface | InkSurface, rng: np.random.Generator) -> tuple[FloatMap, FloatMap]:
    """Mean height [m] and inked share of each cell (equations 14 and 15)."""
    if isinstance(surface, InkSurface):
        noise = NOISE / PIXELS * rng.standard_normal((SIDE, SIDE))  # mean of as many pixels
        return surface.height + np.where(surface.area > 0.0, noise, 0.0), surface.area
    pixels = surface.over_grid + NOISE * rng.standard_normal(surface.over_grid.shape)
    inked = pixels > INKED
    by_cell = (SIDE, PIXELS, SIDE, PIXELS)
    height = np.where(inked, pixels, 0.0).reshape(by_cell).mean(axis=(1, 3))
    return height, inked.astype(np.float64).reshape(by_cell).mean(axis=(1, 3))


def _cap_height(volume: float) -> float:
    """Height of a cap of `RADIUS` and this volume: pi h (3 r^2 + h^2) / 6 = V, by Newton."""
    height = 2.0 * volume / (math.pi * RADIUS**2)
    for _ in range(30):
        excess = math.pi * height * (3.0 * RADIUS**2 + height**2) / 6.0 - volume
        height -= excess / (math.pi * (RADIUS**2 + height**2) / 2.0)
    return height
