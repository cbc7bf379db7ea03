"""`inkloop bench`: the nodes of a bench, emulated or real, without printing."""

from __future__ import annotations

import argparse
from typing import Any

from inkloop.commands.bench import doctor, emulate, replay
from inkloop.commands.bench.actions import ACTIONS

PARTS = (emulate, *ACTIONS, doctor, replay)


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command, which its parts are added to."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "bench", help="emulate, inspect or operate the nodes of a bench without printing"
    )
    return parser
