"""`inkloop export surface`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from inkloop.commands.options import screen
from inkloop.exchange.layers import MAP_FORMATS, MESH_FORMATS
from inkloop.results import SURFACES


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "surface", help="write a surface of a run as a mesh or a height map, for metrology tools"
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="run folder, as written by `inkloop run`")
    parser.add_argument(
        "--format", choices=(*MESH_FORMATS, *MAP_FORMATS), required=True, help="closed body, or height map"
    )
    parser.add_argument("--layer", type=int, metavar="N", help="after N layers, 0: start surface (default: last)")
    parser.add_argument("--map", choices=SURFACES, default=SURFACES[0], help="surface to write (default: printed)")
    parser.add_argument("--part", action="store_true", help="the cells of the part only")
    parser.add_argument(
        "--fill-um", type=float, metavar="H", help="height of cells that have none (default: NaN; stl, glb: refused)"
    )
    parser.add_argument(
        "-o", "--out", type=Path, metavar="FILE", help="file to write (default: RUN-MAP-LNNNN with the format's suffix)"
    )
    return parser


def run(options: argparse.Namespace) -> int:
    """Write the file; the exit code."""
    from inkloop.exchange.layers import surface

    return surface.export(options, screen(options))
