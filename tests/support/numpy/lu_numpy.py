"""The layer-to-layer map of Lu, Zheng and Mishra (2015), written with whole padded arrays, no loops over cells."""

from __future__ import annotations

from typing import Any

import numpy as np

from support.numpy.philox_numpy import uniform_map, uniforms

INK = (4.4e-6, 0.6e-6, 0.2e-6)
ORDERS = {1: ((0, 0), (0, 1), (1, 0), (1, 1)), 2: ((0, 0), (1, 1), (0, 1), (1, 0))}


def one_pass(height: Any, pattern: Any, inks: Any = (INK, INK), factor: Any = 1.0) -> tuple[Any, float]:
    """The surface after all droplets of `pattern` (0, 1, 2) and the height that left the grid."""
    nx, ny = height.shape
    table = np.array([(0.0, 0.0, 0.0), *inks])
    h1, h2, h3 = np.moveaxis(table[pattern], -1, 0) * factor
    beyond = np.pad(height, 1, constant_values=-np.inf)
    grown = np.zeros((nx + 2, ny + 2))
    grown[1:-1, 1:-1] += h1
    for di in (-1, 0, 1):
        for dj in (-1, 0, 1):
            if di == dj == 0:
                continue
            share = h2 if di * dj == 0 else h3
            width = np.where(pattern > 0, h1 + share, 1.0)
            rise = height - beyond[1 + di : 1 + di + nx, 1 + dj : 1 + dj + ny]
            given = share * np.clip(1.0 + rise / width, 0.0, 1.0)
            grown[1 + di : 1 + di + nx, 1 + dj : 1 + dj + ny] += given
            grown[1:-1, 1:-1] += share - given
    inside = grown[1:-1, 1:-1]
    return height + inside, float(grown.sum() - inside.sum())


def layer(
    height: Any,
    pattern: Any,
    inks: Any = (INK, INK),
    factor: Any = 1.0,
    passes: int = 1,
    order: int = 1,
    rotation: int = 0,
    number: int = 1,
) -> tuple[Any, float]:
    """One layer in 1 or 4 passes; `number` counts layers from 1."""
    if passes == 1:
        return one_pass(height, pattern, inks, factor)
    i, j = np.indices(height.shape)
    lost = 0.0
    for place in range(4):
        di, dj = ORDERS[order][(place + rotation * number) % 4]
        coloured = np.where((i % 2 == di) & (j % 2 == dj), pattern, 0)
        height, fell = one_pass(height, coloured, inks, factor)
        lost += fell
    return height, lost


def far_pass(
    height: Any, pattern: Any, heights: Any, reach: int, factor: Any = 1.0, colour: Any = None
) -> tuple[Any, float]:
    """As `one_pass` for one ink that reaches further, on the cells of one colour (i % 2, j % 2) if there is one.

    heights: of the cell itself and of (1, 0), (1, 1), (2, 0), (2, 1), (2, 2), (3, 0) ... cells away.
    """
    nx, ny = height.shape
    i, j = np.indices(height.shape)
    jetted = (pattern > 0) & ((colour is None) | ((i % 2, j % 2) == np.reshape(colour or (0, 0), (2, 1, 1))).all(0))  # type: ignore[attr-defined]
    volume = jetted * factor
    beyond = np.pad(height, reach, constant_values=-np.inf)
    grown = np.zeros_like(beyond)
    own = (slice(reach, reach + nx), slice(reach, reach + ny))
    grown[own] += heights[0] * volume
    away = [pair for m in range(reach + 1) for pair in ((m, n) for n in range(m + 1))]
    for di in range(-reach, reach + 1):
        for dj in range(-reach, reach + 1):
            place = away.index((max(abs(di), abs(dj)), min(abs(di), abs(dj))))
            if place == 0:
                continue
            there = (slice(reach + di, reach + di + nx), slice(reach + dj, reach + dj + ny))
            share = heights[place] * volume
            width = np.where(jetted, heights[0] * volume + share, 1.0)
            given = share * np.clip(1.0 + (height - beyond[there]) / width, 0.0, 1.0)
            grown[there] += given
            grown[own] += share - given
    return height + grown[own], float(grown.sum() - grown[own].sum())


def rolled(height: Any, top: float) -> tuple[Any, float]:
    """The surface under a roller at height `top`, and the height that it cut."""
    return np.minimum(height, top), float(np.maximum(height - top, 0.0).sum())


def factors(
    shape: tuple[int, int],
    number: int,
    *,
    seed: int,
    variation: float = 0.0,
    kind: int = 1,
    nozzle_pitch: int = 1,
    nozzle_variation: float = 0.0,
) -> Any:
    """Volume factor of a droplet on every cell in a layer."""
    factor = np.ones(shape)
    if kind == 1:
        factor *= 1.0 - variation * uniform_map(seed, 1, shape, number)
    if kind in (2, 4):
        factor *= 1.0 - variation * uniform_map(seed, 2, shape, 0)
    if kind in (3, 4):
        factor *= 1.0 - variation * uniforms(seed, 3, 0, number)[0]
    nozzles = np.array([uniforms(seed, 4, j % nozzle_pitch, 0)[0] for j in range(shape[1])])
    return factor * (1.0 - nozzle_variation * nozzles)
