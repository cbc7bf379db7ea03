"""`inkloop metrology`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from inkloop.commands.options import screen
from inkloop.exchange.layers import SURFACES
from inkloop.metrology import F_OPERATIONS, UNITS


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "metrology", help="evaluate the texture of a surface: areal parameters of ISO 25178-2"
    )
    parser.add_argument("source", type=Path, metavar="RUN|MAP", help="run folder, or height map of a profiler")
    parser.add_argument("--layer", type=int, metavar="N", help="of a run: after N layers (default: last)")
    parser.add_argument("--map", choices=SURFACES, help="of a run: surface to evaluate (default: printed)")
    parser.add_argument(
        "--mask", metavar="part|all|FILE", help="cells that count; an NPY file (default: part of a run, all of a map)"
    )
    parser.add_argument(
        "--f-operation",
        choices=F_OPERATIONS,
        default=F_OPERATIONS[0],
        help="taken off the heights: least-squares plane (default), or mean height",
    )
    parser.add_argument("--unit", choices=UNITS, help="of the heights of a map that does not give it")
    parser.add_argument("--pixel-um", type=float, metavar="P", help="pixel spacing of a map that does not give it")
    return parser


def run(options: argparse.Namespace) -> int:
    """Show the parameters; the exit code."""
    from inkloop.errors import HeightMapError
    from inkloop.exchange.layers.surface import surface
    from inkloop.report import areal_report
    from inkloop.results.result import Result

    source, is_run = options.source, options.source.is_dir()
    alien = ("unit", "pixel_um") if is_run else ("layer", "map")
    if given := [f"--{name.replace('_', '-')}" for name in alien if getattr(options, name) is not None]:
        raise HeightMapError(f"{source}: is a {'run' if is_run else 'map'}; leave {' and '.join(given)} out")
    if not is_run:
        return areal_report.show(areal_report.read(options), None, options, screen(options))
    result = Result.load(source)
    map_ = surface(result, str(source), name=options.map or SURFACES[0], layer=options.layer)
    return areal_report.show(map_, result.dataset["mask"].values.astype(bool), options, screen(options))
