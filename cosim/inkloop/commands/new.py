"""`inkloop new`."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import Any

from inkloop.commands.options import add_part_options, part_file_of, screen
from inkloop.errors import InkloopError

SHAPES = ("combine", "cuboid", "cylinder", "pipe-junction", "staircase")


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
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
    add_part_options(parser)
    return parser


def run(options: argparse.Namespace) -> int:
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
    if options.part is None:
        path = templates.write(options.name, options.shape)
    else:
        path, part = templates.write_for_part(options.name, part_file_of(options, options.part), options.pitch_um)
        size = " x ".join(f"{side:.6g}" for side in part.size_um)
        grid = part.grid
        terminal.sentence(f"{options.part}: {size} µm on {grid.nx} x {grid.ny} cells of {grid.pitch_um:g} µm")
    terminal.sentence(f"wrote {path}; inkloop run {shlex.quote(str(path))} prints it")
    terminal.result(file=path)
    return 0
