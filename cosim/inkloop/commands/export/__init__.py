"""`inkloop export`: what other tools read."""

from __future__ import annotations

import argparse
from typing import Any

from inkloop.commands.export import fmu, job, layers, schema, services, ssp, surface

PARTS = (fmu, ssp, job, layers, surface, services, schema)


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command, which its parts are added to."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "export", help="write files for other tools: FMUs, systems of FMUs, layers, surfaces, services of nodes"
    )
    return parser
