"""Keys that carry their unit: `pitch_um = 250` says the same as a pitch of 250e-6 m.

SI inside, units in names where a number crosses a file. Units are spelled as in FMI.
"""

from __future__ import annotations

from collections.abc import Mapping

SUFFIXES: Mapping[str, Mapping[str, float]] = {
    "m": {"um": 1e-6, "mm": 1e-3, "nm": 1e-9, "m": 1.0},
    "m2": {"um2": 1e-12, "mm2": 1e-6, "m2": 1.0},
    "m3": {"pl": 1e-15, "nl": 1e-12, "um3": 1e-18, "mm3": 1e-9, "m3": 1.0},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0},
    "m/s": {"um_per_s": 1e-6, "mm_per_s": 1e-3, "m_per_s": 1.0},
    "rad": {"deg": 0.017453292519943295, "mrad": 1e-3, "rad": 1.0},
}
"""SI unit -> suffix of a key -> factor to SI."""

QUANTITIES = {"m": "a length", "m2": "an area", "m3": "a volume", "s": "a time", "m/s": "a speed", "rad": "an angle"}


def spellings(name: str, unit: str) -> dict[str, float]:
    """Keys under which a quantity may be written, each with its factor to `unit`.

    A number without a unit ("1"), or with one that has no suffix here, is written under its plain name in that unit.
    """
    return {f"{name}_{suffix}": factor for suffix, factor in SUFFIXES.get(unit, {}).items()} or {name: 1.0}


def missing_suffix(name: str, unit: str) -> str | None:
    """What is wrong with the plain `name` as a key for a quantity in `unit`, None if nothing is."""
    if unit not in SUFFIXES:
        return None
    *firsts, last = spellings(name, unit)
    return f"{name} is {QUANTITIES[unit]}; write {', '.join(firsts)} or {last}"
