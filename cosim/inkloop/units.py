"""Keys that carry their unit: `pitch_um = 250` says the same as a pitch of 250e-6 m.

SI inside, units in names where a number crosses a file. Units are spelled as in FMI.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from inkloop.suggest import nearest

SUFFIXES: Mapping[str, Mapping[str, float]] = {
    "1/m": {"per_um": 1e6, "per_mm": 1e3, "per_m": 1.0},
    "m": {"um": 1e-6, "mm": 1e-3, "nm": 1e-9, "m": 1.0},
    "m2": {"um2": 1e-12, "mm2": 1e-6, "m2": 1.0},
    "m3": {"pl": 1e-15, "nl": 1e-12, "um3": 1e-18, "mm3": 1e-9, "m3": 1.0},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0},
    "m/s": {"um_per_s": 1e-6, "mm_per_s": 1e-3, "m_per_s": 1.0},
    "rad": {"deg": 0.017453292519943295, "mrad": 1e-3, "rad": 1.0},
}
"""SI unit -> suffix of a key -> factor to SI."""

UNITS: Mapping[str, tuple[str, float]] = {
    suffix.replace("_per_", "/").replace("per_", "1/"): (si, factor)
    for si, suffixes in SUFFIXES.items()
    for suffix, factor in suffixes.items()
}
"""Unit in FMI spelling -> its SI unit and the factor to it."""

QUANTITIES = {
    "1/m": "an inverse length",
    "m": "a length",
    "m2": "an area",
    "m3": "a volume",
    "s": "a time",
    "m/s": "a speed",
    "rad": "an angle",
}


def spellings(name: str, unit: str) -> dict[str, float]:
    """Keys under which a quantity may be written, each with its factor to `unit`.

    A number without a unit ("1"), or with one that has no suffix here, is written under its plain name in that unit.
    """
    si, to_si = UNITS.get(unit, (unit, 1.0))
    return {f"{name}_{suffix}": factor / to_si for suffix, factor in SUFFIXES.get(si, {}).items()} or {name: 1.0}


def unit_of(key: str, name: str, unit: str) -> tuple[str, float]:
    """The unit in which `key` gives the quantity `name`, in FMI spelling, and its factor to `unit`."""
    suffix = key.removeprefix(name).removeprefix("_")
    return suffix.replace("_per_", "/").replace("per_", "1/") or unit, spellings(name, unit)[key]


def read_quantities(
    found: Mapping[str, object], units: Mapping[str, str], other_keys: Iterable[str] = ()
) -> tuple[dict[str, tuple[str, object]], list[str]]:
    """By quantity of a table the key as written and the value in `units` (quantity -> unit); what is wrong with keys.

    A value is a number, a boolean or a nested list of them; `other_keys` are known to the table besides.
    """
    keys = {key: (name, to_unit) for name, unit in units.items() for key, to_unit in spellings(name, unit).items()}
    values: dict[str, tuple[str, object]] = {}
    faults: list[str] = []
    for key, value in found.items():
        if key not in keys:
            plain = missing_suffix(key, units[key]) if key in units else None
            faults.append(plain or f"{key} is not a key of this table; {nearest(key, (*keys, *other_keys))}")
            continue
        name, factor = keys[key]
        if name in values:
            faults.append(f"{key} says again what {values[name][0]} says; keep one")
        values[name] = key, scaled(value, factor)
    return values, faults


def scaled(value: object, factor: float) -> object:
    """A number or nested list of numbers times `factor`; anything else as it is, to be refused by who reads it."""
    if factor == 1.0:
        return value
    try:
        array = np.asarray(value)
    except ValueError:
        return value
    if array.dtype.kind not in "iuf":
        return value
    return (array * factor).item() if array.ndim == 0 else array * factor


def conversion(source: str, target: str) -> float | None:
    """Factor from one unit to another, None if they are not known to be of the same quantity."""
    if source == target:
        return 1.0
    (source_si, from_source), (target_si, from_target) = (UNITS.get(unit, (unit, 1.0)) for unit in (source, target))
    return from_source / from_target if source_si == target_si else None


def missing_suffix(name: str, unit: str) -> str | None:
    """What is wrong with the plain `name` as a key for a quantity in `unit`, None if nothing is."""
    if unit not in UNITS:
        return None
    *firsts, last = spellings(name, unit)
    return f"{name} is {QUANTITIES[UNITS[unit][0]]}; write {', '.join(firsts)} or {last}"
