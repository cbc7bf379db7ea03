"""`inkloop compare`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from inkloop.commands.options import add_pictures, formats_of, screen


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "compare", help="compare several runs on the same grid in one table and one picture"
    )
    parser.add_argument("runs", type=Path, nargs="+", metavar="RUN", help="run folder, as written by `inkloop run`")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("compare"),
        metavar="FILE",
        help="picture to write (default: compare.png); its suffix is a format, as of --pictures",
    )
    add_pictures(parser, default=None)
    return parser


def run(options: argparse.Namespace) -> int:
    """Show the table and write the picture; the exit code."""
    from inkloop.report import run_report

    terminal = screen(options)
    table, runs, pictures = run_report.compare(options.runs, options.out, formats_of(options))
    terminal.print(table)
    for picture in pictures:
        terminal.sentence(f"wrote {picture}")
    terminal.result(runs=runs, pictures=pictures)
    return 0
