"""Statements in the lines above a table of heights: unit, size of a pixel, size of the grid, mark of a missing height.

Of a line are understood `key = 5 um`, `key [um]; 5`, `key_um, 5`, `"key","5","um"` and `key 5`, with or without a
leading #, "Height [um]" alone, and the titles of columns, `x [mm]; z [um]`. In any language are understood the four
lines of Gwyddion: channel, width, height, unit. Other lines are skipped.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from inkloop.metrology.map_readers import Pixel, length_factor

NUMBER = r"[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?"
_UNIT = r"(?:nm|um|\u00b5m|\u03bcm|mm|pm|m)"
_LINE = re.compile(
    rf"""^[\s\#"']*
    (?P<key>[^\W\d_](?:[^\W\d]|[ .\-/])*?)
    (?:_(?P<suffix>{_UNIT}))?
    \s*(?:[\[(]\s*(?P<bracket>{_UNIT})(?:\s*/\s*(?:px|pixel|pix))?\s*[\])])?
    (?P<between>[\s"'=:;,\t]*)
    (?P<number>{NUMBER})?
    [\s"';,\t]*
    (?:[\[(]?\s*(?P<after>{_UNIT})(?:\s*/\s*(?:px|pixel|pix))?\s*[\])]?)?
    [\s"';,\t]*$""",
    re.VERBOSE,
)
_RUNS = re.compile(r"""[\s"';,]{2,}""")
_TITLE = re.compile(rf"\b([^\W\d_]+)\s*[_\[(/]\s*({_UNIT})(?![^\W_])")
_KEY = r"\#[^:\uff1a\n]+[:\uff1a]"
_GWYDDION = re.compile(
    rf"""^{_KEY}.*\n
    {_KEY}\s*(?P<dx>{NUMBER})\s*(?P<dx_unit>{_UNIT})\s*\n
    {_KEY}\s*(?P<dy>{NUMBER})\s*(?P<dy_unit>{_UNIT})\s*\n
    {_KEY}\s*(?P<unit>{_UNIT})\s*$""",
    re.VERBOSE | re.MULTILINE,
)
_HEIGHTS = {"height", "heights", "surface", "topography", "unit", "units", "z"}
_HEIGHTS |= {"height unit", "unit z", "value unit", "value units", "z unit", "z units"}
_STEPS = {
    "both": {"pixel", "pixel size", "pixel pitch", "pixel spacing", "xy calibration", "spacing", "step", "sampling"},
    "dx": {"dx", "x step", "step x", "x spacing", "x pixel size", "pixel size x", "pixel width", "x pixel", "pixel x"},
    "dy": {"dy", "y step", "step y", "y spacing", "y pixel size", "pixel size y", "pixel height", "y pixel", "pixel y"},
}
_FIELDS = {
    "dx": {"width", "field width", "x size", "size x"},
    "dy": {"height", "field height", "y size", "size y"},
}
_COUNTS = {
    "dx": {"ncols", "columns", "cols", "nx", "x pixels", "pixels x", "x points", "points x"},
    "dy": {"nrows", "rows", "ny", "y pixels", "pixels y", "y points", "points y"},
}
_MISSING = {"nodata value", "nodata", "no data", "no data value", "missing value", "invalid value", "bad value"}


@dataclass(frozen=True)
class Header:
    """unit: of the heights; invalid: the number of a pixel without a height; titles: (name, unit) of the columns.

    steps: "dx", "dy", "both": size of a pixel [m]; fields: "dx", "dy": width and height of the field [m]; counts: the
    same: numbers of columns and rows. What the lines do not state is None or missing.
    """

    unit: str | None = None
    invalid: float | None = None
    titles: Sequence[tuple[str, str]] = ()
    steps: Mapping[str, float] = field(default_factory=dict)
    fields: Mapping[str, float] = field(default_factory=dict)
    counts: Mapping[str, int] = field(default_factory=dict)

    def size(self, name: str, count: int) -> float | None:
        """Size of a pixel [m], "dx" or "dy", in a table of so many columns or rows; None where it is not stated."""
        step = self.steps.get(name, self.steps.get("both"))
        return self.fields[name] / count if step is None and name in self.fields else step

    def pixel(self, columns: int, rows: int) -> Pixel:
        """Both sizes [m], None where one of them is not stated."""
        dx, dy = self.size("dx", columns), self.size("dy", rows)
        return None if dx is None or dy is None else (dx, dy)


def read_header(lines: Sequence[str]) -> Header:
    """Statements of the lines above a table."""
    unit, invalid = None, None
    steps: dict[str, float] = {}
    fields: dict[str, float] = {}
    counts: dict[str, int] = {}
    for found in filter(None, (_LINE.match(_RUNS.sub(" ", line)) for line in lines)):
        key = " ".join(found["key"].lower().replace("_", " ").split())
        stated = found["suffix"] or found["bracket"] or found["after"]
        if found["number"] is None:
            unit = stated if stated and key in _HEIGHTS else unit
        elif stated is None:
            number = _number(found["number"])
            invalid = number if key in _MISSING else invalid
            counts |= {name: int(number) for name, keys in _COUNTS.items() if key in keys and number.is_integer()}
        else:
            length = _length(found["number"], stated)
            steps |= {name: length for name, keys in _STEPS.items() if key in keys}
            fields |= {name: length for name, keys in _FIELDS.items() if key in keys}
    foreign = _GWYDDION.search("\n".join(lines))
    if foreign and not steps and len(fields) < 2:
        fields = {name: _length(foreign[name], foreign[f"{name}_unit"]) for name in ("dx", "dy")}
        unit = foreign["unit"]
    titles = [found for found in map(_TITLE.findall, lines) if len(found) > 1]
    return Header(unit, invalid, titles[-1] if titles else (), steps, fields, counts)


def _number(text: str) -> float:
    return float(text.replace(",", "."))


def _length(text: str, unit: str) -> float:
    return _number(text) * (length_factor(unit) or 0.0)
