"""Points that fill the space of some keys: distributions, low-discrepancy sequences, the points of Saltelli."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.errors import nearest

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


PARAMETERS = {
    "uniform": ("low", "high"),
    "loguniform": ("low", "high"),
    "normal": ("mean", "std"),
    "truncated-normal": ("mean", "std", "low", "high"),
    "integers": ("first", "last"),
}
"""Distribution -> its parameters; besides them `choice`, a list of values that are equally likely."""
KINDS = (*PARAMETERS, "choice")
TAIL = 0.001
"""Share of a normal distribution on each side that the check of a study leaves out."""
TINY = 1e-12
"""Smallest share of a normal distribution, whose ends are infinite."""


@dataclass(frozen=True)
class Distribution:
    """Distribution of a key over its values; `parameters` in the order of PARAMETERS, of `choice` the values."""

    kind: str
    parameters: tuple[Any, ...]

    def values(self, shares: NDArray[np.float64]) -> list[Any]:
        """Values of the key at these quantiles, each in [0, 1)."""
        if self.kind == "choice":
            count = len(self.parameters)
            return [self.parameters[min(int(share * count), count - 1)] for share in shares]
        if self.kind == "integers":
            first, last = self.parameters
            return [min(first + int(share * (last - first + 1)), last) for share in shares]
        ends = TINY if self.kind == "normal" else 0.0
        values = self._continuous().ppf(np.clip(np.asarray(shares, np.float64), ends, 1.0 - ends))
        low, high = (-math.inf, math.inf) if self.kind == "normal" else self.parameters[-2:]
        return [float(value) for value in np.clip(values, low, high)]

    def extremes(self) -> list[Any]:
        """Values that a study checks before its first print: the ends, of a choice all of them."""
        if self.kind == "choice":
            return list(self.parameters)
        ends = (TAIL, 1.0 - TAIL) if self.kind == "normal" else (0.0, 1.0)
        return self.values(np.array(ends))

    def _continuous(self) -> Any:
        """The distribution of SciPy."""
        from scipy import stats

        first, second = map(float, self.parameters[:2])
        match self.kind:
            case "uniform":
                return stats.uniform(first, second - first)
            case "loguniform":
                return stats.loguniform(first, second)
            case "normal":
                return stats.norm(first, second)
        low, high = ((float(end) - first) / second for end in self.parameters[2:])
        return stats.truncnorm(low, high, first, second)


def distribution(table: dict[str, Any]) -> Distribution:
    """The distribution of a table with one key, such as {"uniform": [0.0, 0.4]}. Raises ValueError."""
    if len(table) != 1:
        raise ValueError(f"is {table!r}; expected one distribution: {', '.join(KINDS)}")
    ((kind, parameters),) = table.items()
    if kind not in KINDS:
        raise ValueError(f"has {kind}, which is no distribution; {nearest(kind, KINDS)}")
    if not isinstance(parameters, list):
        raise ValueError(f"{kind} is {parameters!r}; expected {_form(kind)}")
    if kind == "choice":
        if len(parameters) < 2:
            raise ValueError(f"choice is {parameters!r}; expected a list of two values or more")
        return Distribution(kind, tuple(parameters))
    wrong = _error(kind, parameters)
    if wrong is not None:
        raise ValueError(f"{kind} is {parameters!r}; expected {_form(kind)}{wrong}")
    return Distribution(kind, tuple(parameters))


def _form(kind: str) -> str:
    return f"[{', '.join(PARAMETERS[kind])}]" if kind in PARAMETERS else "a list of values"


def _error(kind: str, found: Sequence[Any]) -> str | None:
    """Error of the parameters, None if they are well."""
    type_ = int if kind == "integers" else int | float
    if len(found) != len(PARAMETERS[kind]):
        return ""
    if any(isinstance(each, bool) or not isinstance(each, type_) or not math.isfinite(each) for each in found):
        return ", whole numbers" if kind == "integers" else ", numbers"
    if "normal" in kind and found[1] <= 0:
        return " with std above 0"
    if kind != "normal" and not found[-2] < found[-1]:
        return f" with {PARAMETERS[kind][-2]} below {PARAMETERS[kind][-1]}"
    return " with low above 0" if kind == "loguniform" and found[0] <= 0 else None
