"""`inkloop export ssp`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from inkloop.commands.options import add_overrides, add_platforms, scenario_of, screen
from inkloop.exchange.ssp import FORMATS, VERSIONS


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "ssp", help="write a scenario as a system of FMUs for other tools: SSP, libcosim, Maestro"
    )
    parser.add_argument("scenario", type=Path, metavar="SCENARIO", help="scenario file (.toml)")
    parser.add_argument(
        "-o",
        "--out",
        type=Path,
        metavar="PATH",
        help="file to write, for osp and maestro a new folder (default: NAME.ssp, NAME-osp, ...)",
    )
    parser.add_argument("--to", choices=FORMATS, default="ssp", help="format to write (default: ssp)")
    parser.add_argument(
        "--ssp",
        choices=tuple(VERSIONS),
        default="1.0",
        help="SSP version: 1.0 with FMI 2 and scalars (default), 2.0 with FMI 3 and arrays",
    )
    parser.add_argument("--fmi", choices=("2", "3"), help="FMI version of inkloop's FMUs in the system")
    add_platforms(parser)
    add_overrides(parser)
    return parser


def run(options: argparse.Namespace) -> int:
    """Write the system; the exit code."""
    from inkloop.exchange.ssp import command

    with scenario_of(options) as scenario:
        return command.export(scenario, options, screen(options))
