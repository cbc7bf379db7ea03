"""`inkloop sweep`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from inkloop.commands.options import add_pictures, formats_of, screen


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "sweep", help="print a scenario with many settings and seeds: which of them matter, which are best"
    )
    parser.add_argument("study", type=Path, metavar="STUDY", help="study file (.toml): scenario, keys, seeds")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="new folder (default: runs/NAME, or runs/NAME-2, ... if that exists)"
    )
    parser.add_argument(
        "--resume",
        action="store_true",
        help="continue a study however it was stopped, in --out (default: the last of runs/NAME, runs/NAME-2, ...)",
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--workers", type=int, metavar="N", help="prints at a time, in processes (default: as many as there are cores)"
    )
    where.add_argument(
        "--scheduler", metavar="ADDRESS", help="print on a running Dask cluster, e.g. tcp://10.0.0.1:8786"
    )
    parser.add_argument("--check", action="store_true", help="check the study and count its prints; print nothing")
    add_pictures(parser)
    return parser


def run(options: argparse.Namespace) -> int:
    """Print the study and say what it found; the exit code, 3 where prints have failed."""
    from inkloop_lab.sweep import command

    options.pictures = () if options.check else formats_of(options)
    return command.sweep(options, screen(options))
