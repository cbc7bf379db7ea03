"""Read the header above a table of heights: the unit of the heights and the size of a pixel.

Understood are `key = 5 um`, `key [um]; 5`, `key_um, 5` and `"key","5","um"`, with or without a leading #, and
"Height [um]" alone. Other lines are skipped.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from inkloop.metrology.file_contents import length_factor

_UNIT = r"(?:nm|um|\u00b5m|\u03bcm|mm|pm|m)"
_LINE = re.compile(
    rf"""^[\s\#"']*
    (?P<key>[A-Za-z][A-Za-z .\-/]*?(?:_[xy])?)
    (?:_(?P<suffix>{_UNIT}))?
    \s*(?:[\[(]\s*(?P<bracket>{_UNIT})(?:\s*/\s*(?:px|pixel|pix))?\s*[\])])?
    (?P<between>[\s"'=:;,\t]*)
    (?P<number>[+-]?\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?)?
    [\s"';,\t]*
    (?:[\[(]?\s*(?P<after>{_UNIT})(?:\s*/\s*(?:px|pixel|pix))?\s*[\])]?)?
    [\s"';,\t]*$""",
    re.VERBOSE,
)

_HEIGHTS = {"height", "heights", "surface", "topography", "unit", "units", "z"}
_HEIGHTS |= {"height unit", "unit z", "value unit", "value units", "z unit", "z units"}
_STEP = {"pixel", "pixel size", "pixel pitch", "pixel spacing", "xy calibration", "spacing", "step", "sampling"}
_STEP_X = {"dx", "x step", "step x", "x spacing", "x pixel size", "pixel size x", "pixel width", "x pixel", "pixel_x"}
_STEP_Y = {"dy", "y step", "step y", "y spacing", "y pixel size", "pixel size y", "pixel height", "y pixel", "pixel_y"}
_FIELD_X = {"width", "field width", "x size", "size x"}
_FIELD_Y = {"height", "field height", "y size", "size y"}


def read_header(lines: Sequence[str], columns: int, rows: int) -> tuple[str | None, tuple[float, float] | None]:
    """Unit of the heights and pixel size (dx, dy) [m] from the lines; None if missing.

    columns, rows: size of the table, for files that state how wide and high the field is.
    """
    unit: str | None = None
    sizes: dict[str, float] = {}
    for line in lines:
        found = _LINE.match(line)
        if found is None:
            continue
        key = " ".join(found["key"].lower().split())
        stated = found["suffix"] or found["bracket"] or found["after"]
        if found["number"] is None:
            unit = stated if stated and key in _HEIGHTS else unit
            continue
        factor = length_factor(stated) if stated else None
        if factor is not None:
            _note(sizes, key, float(found["number"].replace(",", ".")) * factor, columns, rows)
    dx, dy = sizes.get("dx", sizes.get("both")), sizes.get("dy", sizes.get("both"))
    return unit, None if dx is None or dy is None else (dx, dy)


def _note(sizes: dict[str, float], key: str, length: float, columns: int, rows: int) -> None:
    if key in _STEP:
        sizes["both"] = length
    elif key in _STEP_X:
        sizes["dx"] = length
    elif key in _STEP_Y:
        sizes["dy"] = length
    elif key in _FIELD_X:
        sizes["dx"] = length / columns
    elif key in _FIELD_Y:
        sizes["dy"] = length / rows
