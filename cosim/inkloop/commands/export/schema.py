"""`inkloop export schema`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from inkloop.commands.options import screen


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "schema", help="print the JSON Schema of scenario files, for editors"
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="file to write (default: standard output)")
    return parser


def run(options: argparse.Namespace) -> int:
    """Print or write the schema; the exit code."""
    import json

    from inkloop.files import write_text
    from inkloop.scenario.json_schema import scenario_schema

    text = json.dumps(scenario_schema(), indent=2)
    if options.out is None:
        print(text)
    else:
        write_text(options.out, text + "\n")
        terminal = screen(options)
        terminal.sentence(f"wrote {options.out}")
        terminal.result(file=options.out)
    return 0
