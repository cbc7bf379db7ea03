"""Completion scripts for shells: `inkloop --print-completion bash`."""

from __future__ import annotations

import argparse
from pathlib import Path

import shtab


def script(parser: argparse.ArgumentParser, shell: str) -> str:
    """The script for a shell. Arguments that are paths are completed to files, or to folders where metavar is DIR."""
    if shell not in shtab.SUPPORTED_SHELLS:
        parser.error(f"--print-completion {shell}: expected one of {', '.join(shtab.SUPPORTED_SHELLS)}")
    _mark_paths(parser)
    return shtab.complete(parser, shell)


def _mark_paths(parser: argparse.ArgumentParser) -> None:
    for action in parser._actions:  # argparse has no public way to them
        if isinstance(action, argparse._SubParsersAction):
            for command in set(action.choices.values()):
                _mark_paths(command)
        elif action.type is Path:
            action.complete = shtab.DIR if action.metavar == "DIR" else shtab.FILE  # type: ignore[attr-defined]
