"""`inkloop bench replay`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from inkloop.commands.options import add_overrides, overrides_of, screen


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "replay",
        help="repeat a run on devices from its traffic log, without a bus",
        description="Repeat a run on devices from its traffic log, without a bus. Exit code 0: the master sends the "
        "same requests again; 1: it does not, or the log cannot be used.",
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="run folder with its traffic log")
    parser.add_argument("--log", type=Path, metavar="FILE", help="another log, .blf or .asc (default: the log of RUN)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="keep the replayed run in this new folder")
    add_overrides(parser)
    return parser


def run(options: argparse.Namespace) -> int:
    """Replay and compare; the exit code."""
    from inkloop.bench.replay import replay
    from inkloop.printing.run import scenario_file
    from inkloop.scenario.class_path import classes_from

    with classes_from(scenario_file(options.run).parent):
        return replay(options, overrides_of(options.overrides, str(options.run)), screen(options))
