"""Distributions of a key of the scenario: from a number between 0 and 1 to a value of the key."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.suggest import nearest

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
