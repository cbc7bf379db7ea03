"""Contents of a height map file, before the caller's options complete them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from numpy.typing import NDArray

from inkloop.errors import HeightMapError
from inkloop.units import M_PER_CM, M_PER_PM, SUFFIXES

_METRES = {**SUFFIXES["m"], "pm": M_PER_PM, "cm": M_PER_CM}
_SPELLINGS = {"\u00b5m": "um", "\u03bcm": "um", "micron": "um", "microns": "um"}  # micro sign, Greek mu


@dataclass(frozen=True, eq=False)
class FileContents:
    """Values as stored, with the statements of the file about them, None where it has none.

    values: 2-D, numbers in `unit`, NaN where nothing was measured; pixel: (dx, dy) [m]; rows_along: the coordinate that
    a stored row lies along: "x" where the first index goes along y, as in pictures and tables, "y" where it goes along
    x, as inkloop's own arrays do.
    """

    values: NDArray[Any]
    unit: str | None = None
    pixel: tuple[float, float] | None = None
    rows_along: Literal["x", "y"] = "x"


def length_factor(unit: str) -> float | None:
    """Metres in a unit of length as files spell it, None if it is none."""
    plain = unit.strip()
    return _METRES.get(_SPELLINGS.get(plain, plain))


def required_factor(source: str, unit: str) -> float:
    """Metres in a unit. Raises HeightMapError if it is no length."""
    factor = length_factor(unit)
    if factor is None:
        raise HeightMapError(f"{source}: the unit of its heights is {unit!r}; expected one of nm, um, mm, m")
    return factor
