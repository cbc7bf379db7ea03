"""Patterns from which an ink can be identified: motifs of single droplets on flat ground, and layers of many."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

Pattern = NDArray[np.int32]

MARGIN = 3  # empty cells around layers: one for spill, others for the noise of the scans
TILE = 5  # cells along each side, so that the motifs of two droplets never overlap
DROPLET_MOTIFS: Mapping[str, tuple[str, ...]] = {
    "single": ("...", ".#.", "..."),
    "side": (".#.", "###", ".#."),
    "corner": ("#..", ".#.", "..."),
}
"""Motif -> droplets of one layer on flat ground, cured at once (Lu, Zheng, Mishra 2015, section V-C)."""

PRIOR_MOTIFS: Mapping[str, tuple[str, ...]] = {
    "0 prior": ("...", "...", "..."),
    "1 prior": ("...", "#..", "..."),
    "2 prior": ("...", "#.#", "..."),
    "3 prior": (".#.", "#.#", "..."),
    "4 prior": (".#.", "#.#", ".#."),
    "6 prior": ("###", "#.#", ".#."),
    "7 prior": ("###", "#.#", "##."),
    "8 prior": ("###", "#.#", "###"),
}
"""Motif -> droplets of the first pass around the one of the second (Wu, Chiu 2024, section IV and Fig. 3; the places of
those with 3, 4, 6 and 7 are assumed)."""


def motif(rows: Sequence[str]) -> Pattern:
    """The droplets (3, 3) of a drawing."""
    return np.array([[mark == "#" for mark in row] for row in rows], np.int32)


def droplets_side(samples: int) -> int:
    """Cells along each side of a grid for `samples` of every motif, with an empty tile's margin all around."""
    tiles = int(np.ceil(np.sqrt(samples * (len(DROPLET_MOTIFS) + len(PRIOR_MOTIFS)))))
    return TILE * (tiles + 2)


def droplets(nx: int, ny: int, seed: int = 0) -> list[Pattern]:
    """Two layers of tiles with every motif as often, at places drawn from the seed; the second layer is the centres of
    those with prior droplets. The rest of the grid is a margin.
    """
    tiles = [(i, j) for i in range(TILE, nx - 2 * TILE + 1, TILE) for j in range(TILE, ny - 2 * TILE + 1, TILE)]
    kinds = [motif(rows) for rows in (*DROPLET_MOTIFS.values(), *PRIOR_MOTIFS.values())]
    first, second = np.zeros((nx, ny), np.int32), np.zeros((nx, ny), np.int32)
    order = np.random.default_rng(seed).permutation(len(tiles))
    for place, (i, j) in enumerate(tiles[k] for k in order):
        kind = place % len(kinds)
        first[i + 1 : i + 4, j + 1 : j + 4] = kinds[kind]
        second[i + 2, j + 2] = kind >= len(DROPLET_MOTIFS)
    return [first, second]


def layers(nx: int, ny: int, count: int, seed: int = 0, margin: int = MARGIN) -> list[Pattern]:
    """`count` layers: half a checkerboard and half stripes, which separate h1, h2 and h3 best on flat ground, then
    random ones of half, three quarters and a quarter of the cells, which make steps. `margin` cells around them stay
    empty. Raises ValueError for a grid without a cell inside.
    """
    if min(nx, ny) <= 2 * margin:
        raise ValueError(
            f"the grid is {nx} x {ny}; needs more than {2 * margin} cells each way around a margin of {margin}"
        )
    i, j = np.indices((nx, ny))
    inside = (np.minimum(i, nx - 1 - i) >= margin) & (np.minimum(j, ny - 1 - j) >= margin)
    random = np.random.default_rng(seed)
    made = [np.where(i < nx // 2, (i + j) % 2, j % 2)]
    made += [random.random((nx, ny)) < (0.5, 0.75, 0.25)[k % 3] for k in range(count - 1)]
    return [np.where(inside, pattern, 0).astype(np.int32) for pattern in made]
