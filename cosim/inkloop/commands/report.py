"""`inkloop report`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from inkloop.commands.options import add_pictures, screen


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "report", help="rewrite the tables and pictures of a run folder"
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="run folder, as written by `inkloop run`")
    add_pictures(parser)
    return parser


def run(options: argparse.Namespace) -> int:
    """Write tables and pictures, and show the tables; the exit code."""
    from inkloop.report import run_report

    terminal = screen(options)
    terminal.print(run_report.write(options.run, options.pictures))
    if (options.run / run_report.MODEL_TABLE).is_file():
        terminal.print((options.run / run_report.MODEL_TABLE).read_text(encoding="utf-8"))
    if terminal.as_json:
        terminal.result(**run_report.record(options.run))
    return 0
