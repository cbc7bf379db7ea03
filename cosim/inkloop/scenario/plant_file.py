"""From the FMU of a deposition model to a scenario that prints with it: its maps, their units and their grid."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import tomlkit

from inkloop.component import Ink
from inkloop.contract import HEIGHT, LAYER_COMMAND, MEASURED_HEIGHT, PATTERN
from inkloop.errors import ScenarioError
from inkloop.fmu import FmuDescription, Variable
from inkloop.tables.shapes import Grid
from inkloop.units import UNITS, conversion, is_defined

_NUMBER = re.compile(r"[0-9]+")
_ROWS = re.compile(r"row|line|zeile", re.IGNORECASE)
"""Names before an index that goes along y."""
_LIKELY = {
    "input": re.compile(r"pattern|dose|dot|drop|jet|volume|ink", re.IGNORECASE),
    "output": re.compile(r"height|surface|thick|layer|bed|z", re.IGNORECASE),
}
"""Names of maps of droplets, and of surfaces."""
_UNSTATED = "its number for a droplet"
_ASSUMED_UNIT = "um"
"""Unit of a surface for which the FMU states none."""
_OF_OTHERS = ((LAYER_COMMAND, "output"), (PATTERN, "output"), (HEIGHT, "input"), (MEASURED_HEIGHT, "input"))
"""Signals of the layer contract, in a direction that no printer has."""


@dataclass(frozen=True)
class PlantMap:
    """A map among the variables of an FMU.

    variable: its name, or a template; shape: cells along its first and its second index, 1 for a profile, which has no
    second; first: of a template; rows: whether the first index goes along y, by its name.
    """

    variable: str
    shape: tuple[int, int]
    unit: str
    first: int = 1
    rows: bool = False

    @property
    def grid(self) -> tuple[int, int]:
        """(nx, ny)."""
        return self.shape[::-1] if self.rows else self.shape


@dataclass(frozen=True)
class Plant:
    """The maps of a plant that a scenario connects, and whether it keeps the layer contract itself.

    others: further maps of the same grid.
    """

    file: Path
    pattern: PlantMap
    height: PlantMap
    others: tuple[PlantMap, ...]
    has_handshake: bool

    @property
    def summary(self) -> str:
        """Its maps and its grid."""
        nx, ny = self.pattern.grid
        return f"droplets into {self.pattern.variable}, surface from {self.height.variable}, on {nx} x {ny} cells"

    @property
    def unstated(self) -> list[str]:
        """Assumptions that stand in for statements missing in the FMU."""
        found = []
        if _gain(self.pattern.unit)[1] == _UNSTATED:
            found.append(f"{self.pattern.variable} is 1 for a droplet")
        if conversion(self.height.unit, "m") is None:
            found.append(f"{self.height.variable} is in {_ASSUMED_UNIT}")
        return found


def plant_of(description: FmuDescription) -> Plant:
    """The plant in an FMU. Raises ScenarioError with what it has if no input and output can be its maps."""
    ways = {variable.name: variable.causality for variable in description.variables.values()}
    if not_of_a_plant := [name for name, way in _OF_OTHERS if ways.get(name) == way]:
        found = f"has the {ways[not_of_a_plant[0]]} {not_of_a_plant[0]}, as a controller or a sensor"
        raise ScenarioError(str(description.path), [f"{found}; name the FMU of a printer"])
    maps = {way: list(_maps(description, way)) for way in ("input", "output")}
    pairs = [
        (pattern, height)
        for pattern in maps["input"]
        for height in maps["output"]
        if sorted(pattern.shape) == sorted(height.shape) and _may_be_surface(height.unit)
    ]
    if not pairs:
        found = "; ".join(f"{way}s: {_listed(own)}" for way, own in maps.items())
        raise ScenarioError(
            str(description.path),
            [f"has no input and output that are maps of one grid ({found}); name them in [components.printer.ports]"],
        )
    pattern, height = max(pairs, key=_likelihood)
    others = tuple({each: None for pair in pairs for each in pair if each not in (pattern, height)})
    if height.grid != pattern.grid:
        height = replace(height, rows=not height.rows)
    return Plant(description.path, pattern, height, others, ways.get(LAYER_COMMAND) == "input")


def text_for_plant(path: Path, template: str, plant: Plant) -> str:
    """The scenario at `path` that prints a block with a plant; template: of any scenario.

    The spread of its droplets is unknown, so all of the ink is learnt.
    """
    nx, ny = plant.pattern.grid
    pitch_um = Grid.model_fields["pitch_um"].default
    sides = [f"{edge} = {max(1, round(0.6 * count)) * pitch_um:.6g}" for edge, count in
             (("size_x_um", nx), ("size_y_um", ny))]  # fmt: skip
    part = "\n".join(('[part]\nshape = "cuboid"', *sides, "height_um = 38.0       # 5 full layers"))
    text = template.replace("# {part}\n", part + "\n").replace("nx = 16\nny = 16\n", f"nx = {nx}\nny = {ny}\n")
    text = text.replace('# adapt_ink = "scale"     #', 'adapt_ink = "full"        #')
    begin, end = text.index("[components.printer]"), text.index("[components.profiler]")
    return f"{text[:begin]}{_printer(path, plant)}\n{text[end:]}"


def _printer(path: Path, plant: Plant) -> str:
    file = Path(os.path.relpath(plant.file.absolute(), path.absolute().parent)).as_posix()
    table = tomlkit.document()
    printer = {"kind": "Fmu" if plant.has_handshake else "PlainPlant", "file": file}
    pattern, height = _port(plant.pattern), _port(plant.height)
    gain, of_gain = _gain(plant.pattern.unit)
    pattern["gain"] = gain
    unit_note = ""
    if conversion(plant.height.unit, "m") is None:
        height["unit"] = _ASSUMED_UNIT
        unit_note = "   # the FMU does not state it"
    table["components"] = {"printer": {**printer}}
    lines = [tomlkit.dumps(table).rstrip(), "", "[components.printer.ports]"]
    lines += [f"{PATTERN} = {_inline(pattern)}   # {of_gain}", f"{HEIGHT} = {_inline(height)}{unit_note}"]
    if plant.pattern.rows:
        lines += ['# its first index counts rows, along y; from the top: add mirror = "y" to both']
    elif 1 in plant.pattern.shape:
        lines += ["# a profile along x; if its cells are those of a map: nx and ny under [grid], and {n} for {i}"]
    else:
        lines += ['# mirror = "x", "y" or "xy": axes that count the other way there; transpose = true: y first']
    if plant.others:
        lines += [f"# more of these maps: {_listed(plant.others)}"]
    return "\n".join([*lines, ""])


def _inline(table: dict[str, object]) -> str:
    inline = tomlkit.inline_table()
    inline.update(table)
    return str(inline.as_string())


def _port(found: PlantMap) -> dict[str, object]:
    table: dict[str, object] = {"variable": found.variable}
    if "{" in found.variable and found.first != 1:
        table["first"] = found.first
    if found.rows:
        table["transpose"] = True
    return table


def _gain(unit: str) -> tuple[float, str]:
    """Number in the FMU for a droplet of the default ink, and what it is."""
    pitch, thickness = Grid.model_fields["pitch_um"].default * UNITS["um"][1], Ink().layer_height
    for quantity, amount in (("m3", thickness * pitch**2), ("m", thickness)):
        if (factor := conversion(quantity, unit)) is not None:
            return float(f"{amount * factor:.4g}"), f"[{unit}] of a droplet of the default ink"
    return 1.0, _UNSTATED


def _maps(description: FmuDescription, causality: str) -> Iterator[PlantMap]:
    """Arrays of one or two indices, and scalars that differ in one or two numbers of their names."""
    sizes = description.default_sizes
    variables = [each for each in description.variables.values() if each.causality == causality]
    for variable in variables:
        shape = (*variable.shape(sizes), 1)[:2] if len(variable.dimensions) < 3 else ()
        if math.prod(shape) > 1:
            yield PlantMap(variable.name, (shape[0], shape[1]), variable.unit)
    families: dict[str, list[Variable]] = {}
    for variable in variables:
        if not variable.dimensions:
            families.setdefault(_NUMBER.sub("#", variable.name), []).append(variable)
    for members in families.values():
        yield from _family(members)


def _family(members: Sequence[Variable]) -> Iterator[PlantMap]:
    """Scalars whose names differ in a number that counts on, or in two that count a whole rectangle."""
    texts = [_NUMBER.findall(each.name) for each in members]
    numbers = [[int(text) for text in row] for row in texts]
    varying = [place for place, column in enumerate(zip(*numbers, strict=True)) if len(set(column)) > 1]
    if len(varying) not in (1, 2) or len({(each.type, each.unit) for each in members}) > 1:
        return
    along = [sorted({row[place] for row in numbers}) for place in varying]
    first = along[0][0]
    whole = all(own == list(range(first, first + len(own))) for own in along)
    if not whole or len(members) != math.prod(map(len, along)):
        return
    name, places = members[0].name, iter(range(len(numbers[0])))
    widths = [_width({row[place] for row in texts}) for place in varying]
    if None in widths:
        return
    signs = dict(zip(varying, (f"{{{index}{width}}}" for index, width in zip("ij", widths, strict=False)), strict=True))
    template = _NUMBER.sub(lambda match: signs.get(next(places), match[0]), name)
    rows = len(along) == 2 and bool(_ROWS.search(template.partition("{i")[0]))
    nx, ny = (*map(len, along), 1)[:2]
    yield PlantMap(template, (nx, ny), members[0].unit, first, rows)


def _width(texts: Iterable[str]) -> str | None:
    """The width of numbers in a template, "" for those without leading zeros; None if they have no one width."""
    if not any(text.startswith("0") and len(text) > 1 for text in texts):
        return ""
    lengths = {len(text) for text in texts}
    return f":0{lengths.pop()}" if len(lengths) == 1 else None


def _likelihood(pair: tuple[PlantMap, PlantMap]) -> tuple[bool, bool, bool, bool, int]:
    pattern, height = pair
    return (
        1 not in pattern.shape,
        conversion(height.unit, "m") is not None,
        bool(_LIKELY["output"].search(height.variable)),
        bool(_LIKELY["input"].search(pattern.variable)),
        math.prod(pattern.shape),
    )


def _may_be_surface(unit: str) -> bool:
    return conversion(unit, "m") is not None or not is_defined(unit)


def _listed(maps: Iterable[PlantMap]) -> str:
    shown = (f"{each.variable} of {each.shape[0]} x {each.shape[1]} [{each.unit}]" for each in maps)
    return ", ".join(shown) or "none"
