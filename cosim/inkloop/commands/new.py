"""`inkloop new`."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import Any

from inkloop.commands.options import screen
from inkloop.scenario import new as templates


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser("new", help="write a commented scenario to start from")
    parser.add_argument("name", type=Path, metavar="NAME", help="writes NAME.toml")
    parser.add_argument(
        "--shape", choices=templates.shapes(), default="cylinder", help="shape of the part (default: cylinder)"
    )
    return parser


def run(options: argparse.Namespace) -> int:
    """Write the scenario; the exit code."""
    path = templates.write(options.name, options.shape)
    terminal = screen(options)
    terminal.sentence(f"wrote {path}; inkloop run {shlex.quote(str(path))} prints it")
    terminal.result(file=path)
    return 0
