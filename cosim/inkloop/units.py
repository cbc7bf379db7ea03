"""Units of measurement: the only place with a factor between two of them.

SI inside. Where a number crosses a file, its key carries the unit: `pitch_um = 250` is a pitch of 250e-6 m. Units are
spelled as in FMI.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isclose, isfinite
from typing import NamedTuple

UM_PER_M, M_PER_UM = 1e6, 1e-6
MM_PER_M, NM_PER_M, M_PER_PM = 1e3, 1e9, 1e-12
M_PER_CM, M_PER_INCH = 1e-2, 2.54e-2
PL_PER_M3, NL_PER_M3, MM3_PER_M3 = 1e15, 1e12, 1e9
NS_PER_S, S_PER_NS = 1_000_000_000, 1e-9
US_PER_S, MS_PER_S, S_PER_MS = 1e6, 1e3, 1e-3
KILO, MEGA, GIGA = 1000, 1e6, 1e9
"""A value in the second unit times the factor is in the first; of counts, bits and bytes powers of a thousand."""

LENGTHS: Mapping[str, float] = {"um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254, "ft": 0.3048}
"""Metres in the units of mesh files."""

SUFFIXES: Mapping[str, Mapping[str, float]] = {
    "1/m": {"per_um": 1e6, "per_mm": 1e3, "per_m": 1.0},
    "m": {"um": 1e-6, "mm": 1e-3, "nm": 1e-9, "m": 1.0},
    "m2": {"um2": 1e-12, "mm2": 1e-6, "m2": 1.0},
    "m3": {"pl": 1e-15, "nl": 1e-12, "um3": 1e-18, "mm3": 1e-9, "m3": 1.0},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0},
    "m/s": {"um_per_s": 1e-6, "mm_per_s": 1e-3, "m_per_s": 1.0},
    "rad": {"deg": 0.017453292519943295, "mrad": 1e-3, "rad": 1.0},
}
"""SI unit -> suffix of a key -> factor to SI. The first suffix is that of the keys of a scenario."""


def _unit(suffix: str) -> str:
    """The unit of a suffix in FMI spelling."""
    return suffix.replace("_per_", "/").replace("per_", "1/")


UNITS: Mapping[str, tuple[str, float]] = {
    _unit(suffix): (si, factor) for si, suffixes in SUFFIXES.items() for suffix, factor in suffixes.items()
}
"""Unit in FMI spelling -> its SI unit and the factor to it."""

BASE_UNITS: Mapping[str, Mapping[str, int]] = {
    "1": {},
    "1/m": {"m": -1},
    "m": {"m": 1},
    "m2": {"m": 2},
    "m3": {"m": 3},
    "s": {"s": 1},
    "m/s": {"m": 1, "s": -1},
    "rad": {"rad": 1},
}
"""SI unit -> exponents of the base units."""

QUANTITIES = {
    "1/m": "an inverse length",
    "m": "a length",
    "m2": "an area",
    "m3": "a volume",
    "s": "a time",
    "m/s": "a speed",
    "rad": "an angle",
}


class DefinedUnit(str):
    """The name of a unit that an FMU defines itself: factor * value + offset is the value in the SI unit `si`."""

    si: str
    factor: float
    offset: float

    def __new__(cls, name: str, si: str, factor: float, offset: float = 0.0) -> DefinedUnit:
        """The name, with its definition."""
        unit = super().__new__(cls, name)
        unit.si, unit.factor, unit.offset = si, factor, offset
        return unit


def defined_unit(name: str, exponents: Mapping[str, int], factor: float, offset: float) -> str:
    """A unit as an FMU defines it (FMI 3.0, 2.4.3): base value = factor * value + offset.

    exponents: of the base units kg, m, s, A, K, mol, cd, rad. The plain name where it means the same here. Raises
    ValueError for a factor that converts nothing.
    """
    if factor == 0.0 or not (isfinite(factor) and isfinite(offset)):
        raise ValueError(f"unit {name!r} has factor {factor}, offset {offset}; expected numbers, no factor 0")
    powers = {base: power for base, power in exponents.items() if power}
    product = ".".join(base + (f"{power}" if power != 1 else "") for base, power in powers.items())
    si = next((si for si, own in BASE_UNITS.items() if own == powers), product)
    known_si, known_factor = si_unit(name)
    is_known_here = name in UNITS and si == known_si and isclose(factor, known_factor) and offset == 0.0
    return name if is_known_here else DefinedUnit(name, si, factor, offset)


def si_unit(unit: str) -> tuple[str, float]:
    """The SI unit of the quantity and the factor to it; of an unknown unit, or one with an offset, itself."""
    if not isinstance(unit, DefinedUnit):
        return UNITS.get(unit, (unit, 1.0))
    return (unit.si, unit.factor) if unit.offset == 0.0 else (unit, 1.0)


def is_known(unit: str) -> bool:
    """Whether the unit is of one of the quantities above."""
    return si_unit(unit)[0] in SUFFIXES


def is_defined(unit: str) -> bool:
    """Whether the unit is known, or defined by an FMU as one of a quantity, and not as a mere number."""
    return is_known(unit) or (isinstance(unit, DefinedUnit) and unit.si != "1")


class Key(NamedTuple):
    """The key of a quantity in a file. unit: of its numbers, in FMI spelling; factor: from there to the quantity's."""

    text: str
    unit: str
    factor: float


def key_of(name: str, unit: str) -> Key:
    """The key of a quantity of a scenario: lengths in um, times in s, angles in deg.

    A number without a unit ("1"), or with one that has no suffix here, has its plain name.
    """
    si, to_si = si_unit(unit)
    keys = (_key(name, suffix, factor / to_si) for suffix, factor in SUFFIXES.get(si, {}).items())
    return next(keys, Key(name, unit, 1.0))


def declared_key(name: str, unit: str) -> Key:
    """The key of a parameter in the file of an FMU: in the unit that the FMU declares, if a suffix names it."""
    si, to_si = si_unit(unit)
    suffixes = (suffix for suffix, factor in SUFFIXES.get(si, {}).items() if factor == to_si)
    return next((_key(name, suffix, 1.0) for suffix in suffixes), key_of(name, unit))


class Conversion(NamedTuple):
    """From one unit to another: factor * value + offset."""

    factor: float
    offset: float = 0.0

    def then(self, other: Conversion) -> Conversion:
        """This one, then the other."""
        return Conversion(other.factor * self.factor, other.factor * self.offset + other.offset)


def unit_conversion(source: str, target: str) -> Conversion | None:
    """The conversion from one unit to another, None if they are not known to be of the same quantity."""
    (source_si, factor, offset), (target_si, to_factor, to_offset) = map(_definition, (source, target))
    if source_si == target_si:
        return Conversion(factor / to_factor, (offset - to_offset) / to_factor)
    is_undefined = any(not isinstance(unit, DefinedUnit) and unit not in UNITS for unit in (source, target))
    return Conversion(1.0) if source == target and is_undefined else None


def conversion(source: str, target: str) -> float | None:
    """Factor from one unit to another, None if a factor alone does not convert."""
    found = unit_conversion(source, target)
    return found.factor if found and found.offset == 0.0 else None


def _definition(unit: str) -> tuple[str, float, float]:
    return (
        (unit.si, unit.factor, unit.offset) if isinstance(unit, DefinedUnit) else (*UNITS.get(unit, (unit, 1.0)), 0.0)
    )


def _key(name: str, suffix: str, factor: float) -> Key:
    return Key(f"{name}_{suffix}", _unit(suffix), factor)


def parts_of(key: str) -> tuple[str, str]:
    """Name and unit of a key, "" if it has none; `_min` ends the least of something, not a time."""
    suffixes = (suffix for own in SUFFIXES.values() for suffix in own if key.endswith(f"_{suffix}") and suffix != "min")
    suffix = max(suffixes, key=len, default="")
    return (key.removesuffix(f"_{suffix}"), _unit(suffix)) if suffix else (key, "")
