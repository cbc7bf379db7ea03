"""`inkloop info`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from inkloop.commands.options import screen
from inkloop.errors import InkloopError


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser("info", help="describe an FMU or a run")
    parser.add_argument("path", type=Path, metavar="FMU|RUN", help="an .fmu file, or a run folder")
    return parser


def run(options: argparse.Namespace) -> int:
    """Show the lines of the description; the exit code."""
    if options.path.is_dir():
        from inkloop.report.run_report import lines

        shown = lines(options.path)
    elif options.path.suffix == ".toml" and options.path.is_file():
        raise InkloopError(f"{options.path}: is a scenario; `inkloop validate` describes it")
    elif not options.path.exists():
        raise InkloopError(f"{options.path}: is not there; name an .fmu file, or a folder that `inkloop run` has made")
    else:
        from inkloop.fmu.reading import describe

        shown = list(describe(options.path).lines())
    terminal = screen(options)
    for line in shown:
        terminal.sentence(line)
    terminal.result(lines=shown)
    return 0
