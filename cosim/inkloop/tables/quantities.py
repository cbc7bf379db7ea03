"""Reading a table whose keys carry their unit."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from inkloop.suggest import nearest
from inkloop.units import missing_suffix, spellings


def read_quantities(
    found: Mapping[str, object], units: Mapping[str, str], other_keys: Iterable[str] = ()
) -> tuple[dict[str, tuple[str, object]], list[str]]:
    """By quantity of a table the key as written and the value in `units` (quantity -> unit); and the errors of the
    keys.

    A value is a number, a boolean or a nested list of them; `other_keys` are further keys of the table.
    """
    keys = {key: (name, to_unit) for name, unit in units.items() for key, to_unit in spellings(name, unit).items()}
    values: dict[str, tuple[str, object]] = {}
    errors: list[str] = []
    for key, value in found.items():
        if key not in keys:
            plain = missing_suffix(key, units[key]) if key in units else None
            errors.append(plain or f"{key} is not a key of this table; {nearest(key, (*keys, *other_keys))}")
            continue
        name, factor = keys[key]
        if name in values:
            errors.append(f"{key} and {values[name][0]} give the same value; keep one")
        values[name] = key, scaled(value, factor)
    return values, errors


def scaled(value: object, factor: float) -> object:
    """A number or nested list of numbers times `factor`; anything else as it is, to be rejected by the reader."""
    if factor == 1.0:
        return value
    try:
        array = np.asarray(value)
    except ValueError:
        return value
    if array.dtype.kind not in "iuf":
        return value
    return (array * factor).item() if array.ndim == 0 else array * factor
