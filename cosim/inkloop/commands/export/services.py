"""`inkloop export services`."""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path
from typing import Any

from inkloop.commands.options import screen
from inkloop.errors import require


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "services", help="write the diagnostic services of the nodes of a bench as a PDX file (ODX), for testers"
    )
    parser.add_argument("file", type=Path, metavar="FILE", help="file to write, such as nodes.pdx")
    return parser


def run(options: argparse.Namespace) -> int:
    """Write the file; the exit code."""
    require("odxtools", "inkloop export services")
    importlib.import_module("inkloop_hardware.protocol.odx_file").write_services(options.file)
    terminal = screen(options)
    terminal.sentence(f"wrote {options.file}: services of head, stage, cure lamp and profiler")
    terminal.result(file=options.file)
    return 0
