"""`inkloop resume`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from inkloop.commands.options import add_isolate, add_pictures, formats_of, is_isolated, screen


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser("resume", help="resume an interrupted run")
    parser.add_argument("run", type=Path, metavar="RUN", help="run folder of the interrupted run")
    parser.add_argument(
        "--layer-is",
        choices=("printed", "blank", "unknown"),
        help="of a rig with its own frames: what a person has seen of the layer that was begun and not finished",
    )
    add_pictures(parser)
    add_isolate(parser)
    return parser


def run(options: argparse.Namespace) -> int:
    """Print the remaining layers, in a subprocess where asked; the exit code."""
    from inkloop.printing import run as printing

    with printing.scenario_of_run(options.run) as scenario:
        if not is_isolated(options, scenario):
            seen = options.layer_is
            return printing.resume(scenario, options.run, screen(options), pictures=formats_of(options), layer_is=seen)
        from inkloop.printing.isolation import run_isolated

        return run_isolated([*options.words, "--no-isolate"], options.run, scenario.foreign_fmus)
