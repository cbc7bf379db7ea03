"""`inkloop export fmu`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from inkloop.commands.options import add_platforms, screen


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "fmu", help="write one of inkloop's FMUs for a grid of your size"
    )
    parser.add_argument("model", metavar="MODEL", help="LayerDeposition, ProfileSensor, ...; an unknown name lists all")
    parser.add_argument("--fmi", choices=("2", "3"), default="3", help="FMI version (default: 3)")
    parser.add_argument("--nx", type=int, default=9, metavar="N", help="cells along x (default: 9)")
    parser.add_argument("--ny", type=int, default=9, metavar="N", help="cells along y (default: 9)")
    parser.add_argument(
        "--intervals",
        type=int,
        metavar="N",
        help="LayerController: intervals of height that the region of ink A may have on a cell (default: 2)",
    )
    parser.add_argument(
        "--fixed", action="store_true", help="FMI 3 with constant dimensions, for tools that cannot resize arrays"
    )
    add_platforms(parser)
    parser.add_argument(
        "--force", action="store_true", help="FMI 2 also for a grid whose description many tools cannot read"
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="file to write (default: MODEL.fmu)")
    return parser


def run(options: argparse.Namespace) -> int:
    """Write the FMU; the exit code."""
    from inkloop.fmu_writer.export import export_fmu

    path = export_fmu(
        options.model,
        fmi=options.fmi,
        nx=options.nx,
        ny=options.ny,
        intervals=options.intervals,
        fixed=options.fixed,
        out=options.out or Path(f"{options.model}.fmu"),
        platforms=options.platforms,
        force=options.force,
    )
    terminal = screen(options)
    terminal.sentence(f"wrote {path}")
    terminal.result(file=path)
    return 0
