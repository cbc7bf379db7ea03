"""Points that fill the space of some keys: low-discrepancy sequences, and the points of Saltelli for sensitivities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop_lab.sweep.distributions import Distribution

SOBOL_INDICES = "sobol-indices"
BALANCED = ("sobol", SOBOL_INDICES)
"""Methods whose points are balanced only where their number is a power of two."""
LEAST = 8
"""Points of a block below which no index is computed."""


@dataclass(frozen=True)
class Samples:
    """Values of each key, one for each point; `blocks`: of each point, with the points of Saltelli, else empty.

    The blocks are A, B, and for each key AB with that key from B (Saltelli et al. 2010).
    """

    values: Mapping[str, Sequence[Any]]
    blocks: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(next(iter(self.values.values())))

    def overrides(self, number: int) -> dict[str, Any]:
        """The keys of a point."""
        return {key: values[number] for key, values in self.values.items()}


def sampled(method: str, points: int, seed: int, keys: Mapping[str, Distribution]) -> Samples:
    """The points of a method of `[sample]`; of sobol-indices `points` in each block."""
    shares = _shares(method, points, seed, len(keys))
    if method != SOBOL_INDICES:
        return Samples(_values(shares, keys))
    a, b = np.hsplit(shares, 2)
    mixed = [np.where(np.arange(len(keys)) == number, b, a) for number in range(len(keys))]
    names = ("A", "B", *(f"AB {key}" for key in keys))
    return Samples(_values(np.concatenate([a, b, *mixed]), keys), tuple(np.repeat(names, points).tolist()))


def _values(shares: NDArray[np.float64], keys: Mapping[str, Distribution]) -> dict[str, list[Any]]:
    return {key: spread.values(shares[:, number]) for number, (key, spread) in enumerate(keys.items())}


def _shares(method: str, points: int, seed: int, dimensions: int) -> NDArray[np.float64]:
    """Numbers from 0 to 1, points x dimensions; two sets side by side for sobol-indices."""
    from scipy.stats import qmc

    found: NDArray[np.float64]
    if method == "random":
        found = np.random.default_rng(seed).random((points, dimensions))
    elif method == "latin-hypercube":
        found = qmc.LatinHypercube(dimensions, rng=seed).random(points)
    elif method == "halton":
        found = qmc.Halton(dimensions, rng=seed).random(points)
    else:
        found = qmc.Sobol(dimensions * (2 if method == SOBOL_INDICES else 1), rng=seed).random(points)
    return found
