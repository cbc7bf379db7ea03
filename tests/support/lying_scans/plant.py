"""The printer of the rig: the layer map of Lu, Zheng and Mishra (2015) written out, and droplets that differ from it.

Heights in um, lengths in cells, volumes as shares of the nominal droplet.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import product
from typing import TypeAlias

import numpy as np

from inkloop.component import FloatMap
from support.lying_scans.places import across, continued, spread

Droplet: TypeAlias = Mapping[tuple[int, int], float]
"""Height on the cell that is (larger, smaller) distance away, both >= 0: (0, 0) its own, (1, 0) a side [um]."""

LU: Droplet = {(0, 0): 4.4, (1, 0): 0.6, (1, 1): 0.2}
"""Lu, Zheng, Mishra (2015), Table I: h1, h2, h3."""
WIDE: Droplet = {(0, 0): 3.6, (1, 0): 0.6, (1, 1): 0.2, (2, 0): 0.1, (2, 1): 0.04, (2, 2): 0.02}
"""As much ink as `LU`, a tenth of it two cells away (scenarios/wide-droplets.toml)."""
CAP: Droplet = {(0, 0): 3.208, (1, 0): 0.26, (1, 1): 0.002}
"""A spherical cap that stays as it falls (scenarios/no-flow.toml)."""
WALL_UM = 5.0  # a step to a lower neighbour that counts as a wall: h1 + h2 (assumed)
SATELLITE_REACH = 2  # cells


@dataclass(frozen=True)
class Plant:
    """Behaviour of droplets.

    variation: a droplet lacks up to this share, evenly distributed; volume: of all droplets; volume_loss: share that is
    lost until the nominal end of the print; volume_right: by how much more the right half along x gets than the left;
    placement: (2,) where droplets land off their cell; contraction: (2,) share by which landing places are nearer to
    the grid's middle; satellites: share of droplets that land within two cells of theirs; bleeding: share of a droplet
    at a wall that runs down it, to each side that is lower; kept: share of the whole height, old and new, that is left
    after each layer; dry_rows: first and last row along x that print nothing from layer `dry_from` on (None: none);
    bow: rise of the substrate at the grid's corners, at the nominal end of the print [um].
    """

    droplet: Droplet = field(default_factory=lambda: LU)
    flows: bool = True
    variation: float = 0.2
    volume: float = 1.0
    volume_loss: float = 0.0
    volume_right: float = 0.0
    placement: tuple[float, float] = (0.0, 0.0)
    contraction: tuple[float, float] = (0.0, 0.0)
    satellites: float = 0.0
    bleeding: float = 0.0
    kept: float = 1.0
    dry_rows: tuple[int, int] | None = None
    dry_from: int = 0
    bow: float = 0.0


def deposit(height: FloatMap, drops: FloatMap, droplet: Droplet = LU, flows: bool = True) -> FloatMap:
    """The surface after the droplets of one layer (Lu et al. 2015, eq. 3-5).

    height: (nx, ny) [um]; drops: (nx, ny) volume of the droplet on each cell, 0: none. A neighbour takes the share
    a s, s = clip(1 + (H_p - H_q) / (h1 + a), 0, 1), the cell keeps a (1 - s); beyond the grid s is 1 and the share is
    lost. Without flow s is 1 everywhere.
    """
    nx, ny = height.shape
    reach = max(far for far, _ in droplet)
    beyond = np.pad(height, reach, constant_values=-np.inf)
    grown = np.zeros(beyond.shape)
    own = (slice(reach, reach + nx), slice(reach, reach + ny))
    grown[own] += droplet[0, 0] * drops
    for di, dj in product(range(-reach, reach + 1), repeat=2):
        share = droplet[max(abs(di), abs(dj)), min(abs(di), abs(dj))]
        if di == dj == 0:
            continue
        there = (slice(reach + di, reach + di + nx), slice(reach + dj, reach + dj + ny))
        width = np.where(drops > 0.0, (droplet[0, 0] + share) * drops, 1.0)
        taken = np.clip(1.0 + (height - beyond[there]) / width, 0.0, 1.0) if flows else 1.0
        grown[there] += share * drops * taken
        grown[own] += share * drops * (1.0 - taken)
    return height + grown[own]


def printed(
    plant: Plant, height: FloatMap, drops: FloatMap, layer: int, done: float, rng: np.random.Generator
) -> FloatMap:
    """The surface above the substrate after layer number `layer`, counted from 1.

    height: (nx, ny) before it [um]; drops: (nx, ny) drops commanded on each cell; done: share of the print that is
    over by the nominal number of layers, at most 1.
    """
    u, _ = across(height.shape)
    volume = plant.volume * (1.0 - plant.volume_loss * done) * (1.0 + 0.5 * plant.volume_right * np.sign(u))
    falling = drops * volume * (1.0 - plant.variation * rng.random(height.shape))
    if plant.dry_rows is not None and layer >= plant.dry_from:
        falling[plant.dry_rows[0] : plant.dry_rows[1] + 1] = 0.0
    if plant.satellites > 0.0:
        falling = _strayed(falling, plant.satellites, rng)
    if any(plant.placement) or any(plant.contraction):
        falling = _displaced(falling, plant)
    after = deposit(height, falling, plant.droplet, plant.flows)
    if plant.bleeding > 0.0:
        whole = sum(share * _places(*away) for away, share in plant.droplet.items())
        after += _bled(height, plant.bleeding * whole * falling)
    return plant.kept * after


def substrate(plant: Plant, shape: tuple[int, int], done: float) -> FloatMap:
    """Height of the substrate against the flat ground it was at first, (nx, ny) [um]."""
    u, w = across(shape)
    return 0.5 * plant.bow * done * (u * u + w * w)


def _places(far: int, near: int) -> int:
    """Number of cells at this distance."""
    return 1 if far == 0 else 4 if near in (0, far) else 8


def _strayed(falling: FloatMap, share: float, rng: np.random.Generator) -> FloatMap:
    """Some droplets land on another cell nearby; those beyond the grid are lost."""
    strays = (falling > 0.0) & (rng.random(falling.shape) < share)
    own = SATELLITE_REACH * (2 * SATELLITE_REACH + 2)  # number of the offset (0, 0)
    number = rng.integers((2 * SATELLITE_REACH + 1) ** 2 - 1, size=falling.shape)
    di, dj = np.divmod(number + (number >= own), 2 * SATELLITE_REACH + 1)
    from_i, from_j = np.nonzero(strays)
    i, j = from_i + di[strays] - SATELLITE_REACH, from_j + dj[strays] - SATELLITE_REACH
    inside = (i >= 0) & (i < falling.shape[0]) & (j >= 0) & (j < falling.shape[1])
    landed = np.where(strays, 0.0, falling)
    np.add.at(landed, (i[inside], j[inside]), falling[strays][inside])
    return landed


def _displaced(falling: FloatMap, plant: Plant) -> FloatMap:
    i, j = np.indices(falling.shape)
    middle = [(count - 1) / 2 for count in falling.shape]
    x, y = (
        at + off - pull * (at - centre)
        for at, off, pull, centre in zip((i, j), plant.placement, plant.contraction, middle, strict=True)
    )
    return spread(falling, x, y)


def _bled(height: FloatMap, amount: FloatMap) -> FloatMap:
    """Gain and loss of each cell where `amount` of a droplet runs down each of its walls [um]."""
    nx, ny = height.shape
    around = continued(height, 1)
    change = np.zeros(around.shape)
    for di, dj in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        there = (slice(1 + di, 1 + di + nx), slice(1 + dj, 1 + dj + ny))
        runs = np.where(height - around[there] > WALL_UM, amount, 0.0)
        change[1:-1, 1:-1] -= runs
        change[there] += runs
    return change[1:-1, 1:-1]
