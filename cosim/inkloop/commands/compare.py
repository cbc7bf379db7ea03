"""`inkloop compare`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from inkloop.commands.options import screen


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "compare", help="compare several runs on the same grid in one table and one picture"
    )
    parser.add_argument("runs", type=Path, nargs="+", metavar="RUN", help="run folder, as written by `inkloop run`")
    parser.add_argument(
        "--out", type=Path, default=Path("compare.png"), metavar="FILE", help="picture to write (default: compare.png)"
    )
    parser.add_argument("--no-pictures", action="store_true", help="write no picture")
    return parser


def run(options: argparse.Namespace) -> int:
    """Show the table and write the picture; the exit code."""
    from inkloop.report import run_report

    terminal, picture = screen(options), None if options.no_pictures else options.out
    table, runs = run_report.compare(options.runs, picture)
    terminal.print(table)
    if picture:
        terminal.sentence(f"wrote {picture}")
    terminal.result(runs=runs, picture=picture)
    return 0
