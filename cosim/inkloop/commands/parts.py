"""`inkloop new` and `geometry`: from a shape or the file of a part to a scenario, and a description of the part."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from inkloop.commands import Part
from inkloop.commands.options import add_pictures, formats_of, number, screen
from inkloop.errors import InkloopError, ScenarioError

if TYPE_CHECKING:
    from inkloop.scenario.file import Scenario
    from inkloop.scenario.part_file import PartFile

SHAPES = ("combine", "cuboid", "cylinder", "pipe-junction", "staircase")


def _add_new(commands: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser("new", help="write a commented scenario to start from")
    parser.add_argument("name", type=Path, nargs="?", metavar="NAME", help="writes NAME.toml")
    either = parser.add_mutually_exclusive_group()
    either.add_argument("--list", action="store_true", help="list the scenarios that `inkloop run` knows by name")
    either.add_argument("--shape", choices=SHAPES, default="cylinder", help="shape of the part (default: cylinder)")
    either.add_argument(
        "--part",
        type=Path,
        metavar="FILE",
        help="mesh (STL, OBJ, PLY, 3MF), height map or manifest of layers to print, with a grid for it",
    )
    either.add_argument(
        "--plant", type=Path, metavar="FMU", help="deposition model of another tool to print with, on its grid"
    )
    add_part_options(parser)
    return parser


def _new(options: argparse.Namespace) -> int:
    """Write the scenario; the exit code."""
    from inkloop.scenario import new as templates

    terminal = screen(options)
    if options.list:
        from inkloop.scenario.packaged import titles

        listed = titles()
        width = max(map(len, listed), default=0)
        for name, title in listed.items():
            terminal.sentence(f"{name:{width}}  {title}")
        terminal.result(scenarios=listed)
        return 0
    if options.name is None:
        raise InkloopError("new needs the NAME of the scenario to write; --list lists those of inkloop")
    if options.plant is not None:
        path, plant = templates.write_for_plant(options.name, options.plant)
        terminal.sentence(f"{options.plant}: {plant.summary}")
        if plant.unstated:
            terminal.sentence(f"it does not state these, correct them in {path}: {'; '.join(plant.unstated)}")
    elif options.part is None:
        path = templates.write(options.name, options.shape)
    else:
        file = part_file_of(options, options.part)
        path, part = templates.write_for_part(options.name, file, options.pitch_um, terminal.sentence)
        grid = part.grid
        terminal.sentence(f"{options.part}: {part.size} on {grid.nx} x {grid.ny} cells of {grid.pitch_um:g} µm")
        if part.hangs:
            effect = "adds ink B below" if part.solid.region is None else "leaves out what hangs"
            how_much = f"`inkloop geometry {shlex.quote(str(path))}` says how much"
            terminal.sentence(f"it overhangs: [support] in {path} {effect}; {how_much}")
        if part.to_try:
            terminal.sentence(part.to_try)
    terminal.sentence(f"wrote {path}; inkloop run {shlex.quote(str(path))} prints it")
    terminal.result(file=path)
    return 0


if TYPE_CHECKING:
    from inkloop.report.part_report import MeshReport
    from inkloop.scenario.file import Scenario


def _add_geometry(commands: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        "geometry", help="describe a part before it is printed: size, holes, narrow walls, ink, layers"
    )
    parser.add_argument(
        "file",
        type=Path,
        metavar="FILE",
        help="mesh (STL, OBJ, PLY, 3MF), height map, manifest of layers, or scenario (.toml, or a name of inkloop's)",
    )
    add_part_options(parser)
    parser.add_argument("--nozzle-um", type=float, metavar="W", help="narrowest wall or gap, if more than two cells")
    parser.add_argument("--out", type=Path, metavar="FILE", help="picture to write (default: NAME-geometry.png)")
    add_pictures(parser, default=None)
    return parser


def _geometry(options: argparse.Namespace) -> int:
    """Show the figures and write the picture; the exit code, 1 where the part cannot be printed as it is."""
    from inkloop.scenario import packaged

    options.file = packaged.resolve(options.file)
    mesh, source = _mesh(options), str(options.file)
    data: dict[str, Any] = {"file": source, **(mesh.data() if mesh else {})}
    lines = [source, *(mesh.lines() if mesh else ())]
    try:
        scenario = _scenario(options)
    except ScenarioError:
        _show(options, lines, data)
        raise
    from inkloop.report.part_report import PartReport
    from inkloop.units import M_PER_UM

    nozzle = None if options.nozzle_um is None else options.nozzle_um * M_PER_UM
    with screen(options).progress(transient=True) as progress:
        report = PartReport.of(scenario, nozzle, lambda heights: progress.track(heights, description="walls and gaps"))
    pictures: list[Path] = []
    if formats := formats_of(options):
        from inkloop.report.part_picture import draw

        pictures = draw(report, options.file.name, options.out or Path(f"{options.file.stem}-geometry"), formats)
    data |= {**report.data(), "pictures": pictures}
    lines += [] if mesh else [report.size_line]
    _show(options, [*lines, *report.lines(), *(f"wrote {picture}" for picture in pictures)], data)
    return 0


def _show(options: argparse.Namespace, lines: list[str], data: dict[str, Any]) -> None:
    terminal = screen(options)
    for line in lines:
        terminal.sentence(line)
    terminal.result(**data)


def _mesh(options: argparse.Namespace) -> MeshReport | None:
    """The mesh in the file or of the scenario, if its part is one. Raises InkloopError."""
    from inkloop.report.part_report import MeshReport
    from inkloop.scenario.part_file import ASSUMED_UNIT, mesh_of_file, mesh_of_scenario

    if options.file.suffix == ".toml":
        found = mesh_of_scenario(options.file)
        return None if found is None else MeshReport.of(found)
    file = part_file_of(options, options.file)
    found = mesh_of_file(file)
    return None if found is None else MeshReport.of(found, ASSUMED_UNIT if file.assumes_unit else "")


def _scenario(options: argparse.Namespace) -> Scenario:
    """The scenario of the file, or one around its part. Raises InkloopError."""
    from inkloop.scenario.file import Scenario
    from inkloop.scenario.packaged import classes_from

    if options.file.suffix != ".toml":
        return scenario_of_part(options, options.file)
    no_part_options(options)
    with classes_from(options.file.parent):
        return Scenario.load(options.file)


PARTS = (Part(_add_new, _new), Part(_add_geometry, _geometry))


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
