"""Places of recorded values, and the arrays that a file holds of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

RUN = "run"
"""Role of recorded values of no component."""
_SCALARS = "scalars"
"""First part of the keys of tables of scalars: a file takes much less time for a few of them than for each scalar."""


class Place(NamedTuple):
    """The value of port `name` of the component in `role`, in the row of `layer`."""

    role: str
    name: str
    layer: int


def packed(rows: Mapping[Place, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """The rows as arrays by key: each map alone, scalars in a table for each of their types."""
    found = {f"{place.role}/{place.name}/{place.layer}": row for place, row in rows.items() if row.shape}
    scalars: dict[np.dtype[Any], list[tuple[Any, ...]]] = {}
    for place, row in rows.items():
        if not row.shape:
            scalars.setdefault(row.dtype, []).append((*place, row[()]))
    for dtype, placed in scalars.items():
        role, name = (f"U{max(len(row[column]) for row in placed)}" for column in (0, 1))
        columns = [("role", role), ("name", name), ("layer", np.int64), ("value", dtype)]
        found[f"{_SCALARS}/{dtype}/{placed[-1][2]}"] = np.array(placed, columns)
    return found


def scalars(arrays: Mapping[str, NDArray[Any]]) -> Iterator[tuple[Place, NDArray[Any]]]:
    """The scalars of arrays by key; no map is read."""
    for key in arrays:
        if key.startswith(f"{_SCALARS}/"):
            table = arrays[key]
            for role, name, layer, value in zip(*(table[column] for column in table.dtype.names or ()), strict=True):
                yield Place(str(role), str(name), int(layer)), np.asarray(value)


def keys(arrays: Mapping[str, NDArray[Any]]) -> Iterator[tuple[Place, str]]:
    """The places of all other arrays, and their keys."""
    for key in arrays:
        role, name, layer = key.split("/")
        if role != _SCALARS:
            yield Place(role, name, int(layer)), key
