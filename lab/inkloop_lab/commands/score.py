"""`inkloop score`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from inkloop.commands.options import add_pictures, overrides_of, screen
from inkloop.errors import require
from inkloop_lab.score import PLANTS


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "score", help="compare controllers, including yours, on the plants of the score board"
    )
    parser.add_argument(
        "controller",
        nargs="?",
        metavar="MODULE:CLASS",
        help="your controller, as `kind` in a scenario; env:MODULE:CLASS: a policy (default: all of inkloop's)",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        dest="overrides",
        help="option of your controller; may be repeated",
    )
    parser.add_argument(
        "--plant",
        action="append",
        default=[],
        metavar="PLANT",
        dest="plants",
        help=f"print on this plant only; may be repeated: {', '.join(PLANTS)}, also without the version",
    )
    parser.add_argument("--quick", action="store_true", help="one seed instead of three")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="new folder for tables and picture (default: runs/score)"
    )
    add_pictures(parser)
    return parser


def run(options: argparse.Namespace) -> int:
    """Print on all plants, and show the scores; the exit code."""
    from inkloop.scenario.packaged import classes_from

    require("matplotlib", "inkloop score")
    from inkloop_lab.score import command

    with classes_from(Path.cwd()):
        return command.score(options, overrides_of(options.overrides, "score"), screen(options))
