"""`inkloop bench emulate`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from inkloop.commands.options import add_overrides, scenario_of, screen


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "emulate", help="run the bench emulator: four nodes on a CAN bus of this machine"
    )
    parser.add_argument(
        "scenario",
        type=Path,
        nargs="?",
        metavar="SCENARIO",
        help="scenario file (.toml) that sets grid, ink and sensor",
    )
    parser.add_argument(
        "--port", type=int, metavar="N", help="TCP port on 127.0.0.1 (default: the port of [bench] in the scenario)"
    )
    parser.add_argument("--pty", action="store_true", help="use a pseudo-terminal instead of a port")
    parser.add_argument("--folder", type=Path, metavar="DIR", help="keep journals and surface in this folder")
    parser.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="FAULT",
        help="fault to inject, as KIND[:key=value,...], e.g. loss:probability=1e-3; may be repeated; "
        "docs/reference/bench-faults.md lists all",
    )
    add_overrides(parser)
    return parser


def run(options: argparse.Namespace) -> int:
    """Run the emulator until Ctrl-C; the exit code."""
    from inkloop.bench.commands import emulate

    if options.scenario is None:
        return emulate(None, options, screen(options))
    with scenario_of(options) as scenario:
        return emulate(scenario, options, screen(options))
