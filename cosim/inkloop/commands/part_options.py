"""Options of the file of a part: what the file does not state, the pitch, and the size and turns of a mesh."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from inkloop.commands.options import number, screen
from inkloop.errors import InkloopError

if TYPE_CHECKING:
    from inkloop.scenario.file import Scenario
    from inkloop.scenario.part_file import PartFile

OF_A_MESH = ("rotate", "scale", "height_um")
"""Options of the part in a mesh."""


def add_part_options(parser: argparse.ArgumentParser) -> None:
    """Options for values that the file of a part may omit, and the pitch of a grid for it."""
    parser.add_argument("--pitch-um", type=float, metavar="P", help="size of a cell (default: by the size of the part)")
    parser.add_argument(
        "--unit", metavar="U", help="unit of the file: um, mm ... (default: its own; of a mesh else mm)"
    )
    parser.add_argument("--pixel-um", type=float, metavar="D", help="pixel spacing of a height map that states none")
    parser.add_argument("--count-scale", type=float, metavar="H", help="height of one count, for whole-number maps")
    parser.add_argument("--channel", metavar="NAME", help="name or number of one of several maps in a file")
    parser.add_argument(
        "--rotate",
        type=_turn,
        action="append",
        metavar="AXIS=DEG",
        help="turn a mesh about x, then y, then z, e.g. x=-90, counterclockwise seen against the axis; may be repeated",
    )
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--scale", type=number, metavar="F", help="factor on a mesh")
    size.add_argument("--height-um", type=number, metavar="H", help="scale a mesh, once turned, to this height")


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def part_file_of(options: argparse.Namespace, path: Path) -> PartFile:
    """The file of a part as the command line describes it. Raises InkloopError."""
    from inkloop.scenario.part_file import PartFile

    for name in ("pitch_um", "height_um", "scale"):
        if (value := getattr(options, name)) is not None and not 0.0 < value < float("inf"):
            expected = "a factor" if name == "scale" else "a length"
            raise InkloopError(f"{_option(name)} is {value:g}; expected {expected} above 0")
    given = [name for name in OF_A_MESH if getattr(options, name) is not None]
    file = PartFile(path, options.unit, options.pixel_um, options.count_scale, options.channel)
    if given and not file.is_mesh:
        raise InkloopError(f"{', '.join(map(_option, given))}: goes with a mesh, but {path} is none; leave it out")
    turns = options.rotate or []
    axes = [axis for axis, _ in turns]
    if axes != sorted(set(axes)):
        order = "a part is turned about x, then y, then z; give each axis once, in this order"
        raise InkloopError(f"--rotate {', '.join(axes)}: {order}")
    rotate_deg = [dict(turns).get(axis, 0.0) for axis in "xyz"] if turns else None
    return replace(file, rotate_deg=rotate_deg, scale=options.scale, height_um=options.height_um)


def no_part_options(options: argparse.Namespace) -> None:
    """Raises InkloopError if options describe a part although the scenario or the run has its own."""
    names = ("pitch_um", "unit", "pixel_um", "count_scale", "channel", *OF_A_MESH)
    if given := ", ".join(_option(name) for name in names if getattr(options, name) is not None):
        raise InkloopError(f"{given}: goes with the file of a part; leave it out, or name that file")


def scenario_of_part(options: argparse.Namespace, path: Path, overrides: Mapping[str, Any] | None = None) -> Scenario:
    """The scenario that `inkloop new` writes for the file of a part. Raises InkloopError."""
    from inkloop.scenario import new
    from inkloop.scenario.file import Scenario
    from inkloop.scenario.part_grid import fit

    file, place = part_file_of(options, path), Path(path.name)
    part = fit(file, options.pitch_um, screen(options).sentence)
    return Scenario.of_text(new.text_for_part(place, file, part), str(place), overrides)


def _turn(text: str) -> tuple[str, float]:
    axis, _, angle = text.partition("=")
    if axis not in ("x", "y", "z"):
        raise argparse.ArgumentTypeError(f"is {text!r}; expected an axis and an angle, e.g. x=-90")
    return axis, number(angle)
