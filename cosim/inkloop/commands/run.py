"""`inkloop run`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from inkloop.commands.options import (
    add_isolate,
    add_pictures,
    add_scenario,
    formats_of,
    is_isolated,
    scenario_of,
    screen,
)


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "run", help="print the part of a scenario; writes tables, pictures and a result file"
    )
    add_scenario(parser)
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="new run folder (default: runs/NAME, or runs/NAME-2, ... if that exists)",
    )
    parser.add_argument(
        "--on-part",
        action="append_const",
        const="bench.on_part=true",
        dest="overrides",
        help="on devices: the bed may carry a part, as with --set bench.on_part=true",
    )
    parser.add_argument("--no-compare", action="store_true", help="skip the comparison runs of the scenario")
    add_pictures(parser)
    add_isolate(parser)
    return parser


def run(options: argparse.Namespace) -> int:
    """Print, in a subprocess where asked; the exit code."""
    from inkloop.printing import run as printing

    with scenario_of(options) as scenario:
        if not is_isolated(options, scenario):
            return printing.run(
                scenario,
                options.out,
                screen(options),
                compare=not options.no_compare,
                pictures=formats_of(options),
            )
        from inkloop.printing.isolation import run_isolated

        folder = printing.checked_run_folder(scenario, options.out, options.scenario.stem)
        return run_isolated([*options.words, "--no-isolate", "--out", str(folder)], folder, scenario.foreign_fmus)
