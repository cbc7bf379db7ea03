"""`inkloop export job`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from inkloop.commands.options import add_overrides, add_platforms, scenario_of, screen


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "job", help="write a scenario as one FMU with scalar inputs and outputs, for tools without arrays"
    )
    parser.add_argument("scenario", type=Path, metavar="SCENARIO", help="scenario file (.toml)")
    parser.add_argument("--fmi", choices=("2", "3"), default="2", help="FMI version (default: 2)")
    add_platforms(parser)
    parser.add_argument("-o", "--out", type=Path, metavar="FILE", help="file to write (default: NAME.fmu)")
    add_overrides(parser)
    return parser


def run(options: argparse.Namespace) -> int:
    """Write the FMU; the exit code."""
    from inkloop.exchange.job import command

    with scenario_of(options) as scenario:
        return command.export(scenario, options, screen(options))
