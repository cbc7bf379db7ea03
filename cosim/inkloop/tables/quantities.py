"""Reading a table whose keys carry their unit."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from inkloop.suggest import nearest
from inkloop.units import QUANTITIES, conversion, key_of, parts_of, si_unit


def read_quantities(
    found: Mapping[str, object], units: Mapping[str, str], other_keys: Iterable[str] = ()
) -> tuple[dict[str, tuple[str, object]], list[str]]:
    """By quantity of a table its key and the value in `units` (quantity -> unit); and the errors of the keys.

    A value is a number, a boolean or a nested list of them; `other_keys` are further keys of the table.
    """
    keys = {key_of(name, unit).text: name for name, unit in units.items()}
    errors = [
        other_unit(key, value, keys) or f"{key} is not a key of this table; {nearest(key, (*keys, *other_keys))}"
        for key, value in found.items()
        if key not in keys
    ]
    values = {
        name: (key, scaled(found[key], key_of(name, units[name]).factor)) for key, name in keys.items() if key in found
    }
    return values, errors


def other_unit(key: str, value: object, known: Iterable[str]) -> str | None:
    """The error in a key that gives one of the `known` ones in another unit or in none; None for any other key."""
    name, unit = parts_of(key)
    for right in known:
        own, to_unit = parts_of(right)
        if to_unit and own == key:
            return f"{key} is {QUANTITIES[si_unit(to_unit)[0]]}; write {right}"
        if unit and to_unit and own == name and (factor := conversion(unit, to_unit)) is not None:
            found = scaled(value, factor)
            return f"{key} is in {unit}; write {right}" + ("" if found is value else f" = {_shown(found)}")
    return None


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


def _shown(value: object) -> str:
    """Numbers without the last digits, which a conversion may have changed."""
    return np.array2string(np.asarray(value), separator=", ", threshold=6, formatter={"float": "{:.12g}".format})
