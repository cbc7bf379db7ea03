"""`inkloop bench doctor`."""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from inkloop.commands.options import add_overrides, scenario_of, screen, show_error
from inkloop.errors import ScenarioError

CANNOT_RUN = 2
"""Exit code where the scenario cannot be read."""


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "doctor",
        help="check a bench: adapter, bus, nodes and their messages; gives advice on every finding",
        description="Check a bench. Exit code 0: ready to print; 1: errors found; 2: the scenario cannot be read.",
    )
    parser.add_argument(
        "scenario",
        type=Path,
        nargs="?",
        metavar="SCENARIO",
        help="scenario file (.toml) with a [bench] (default: the bus of python-can's configuration)",
    )
    parser.add_argument("--self-test", action="store_true", help="also test gate and lamp, after confirmation")
    parser.add_argument("--yes", action="store_true", help="with --self-test: do not ask")
    add_overrides(parser)
    return parser


def run(options: argparse.Namespace) -> int:
    """Check the bench and show the findings; the exit code."""
    from inkloop.bench.doctor import examine

    with ExitStack() as stack:
        try:
            scenario = stack.enter_context(scenario_of(options)) if options.scenario else None
        except ScenarioError as error:
            show_error(error, options)
            return CANNOT_RUN
        return examine(scenario, options, screen(options))
