"""`inkloop reproduce`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from inkloop.commands.options import add_pictures, screen
from inkloop.errors import require
from inkloop_lab.reproduce import PAPERS


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "reproduce", help="recompute the figures of a paper and compare them with the published ones"
    )
    parser.add_argument("paper", choices=tuple(PAPERS), metavar="PAPER", help=f"one of {', '.join(PAPERS)}")
    parser.add_argument("--quick", action="store_true", help="fewer prints and coarser grids: half a minute at most")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="new folder for tables and pictures (default: runs/PAPER)"
    )
    add_pictures(parser)
    return parser


def run(options: argparse.Namespace) -> int:
    """Compute and compare; the exit code."""
    require("matplotlib", "inkloop reproduce")
    from inkloop_lab.reproduce.comparison import reproduce

    return reproduce(options, screen(options))
