"""Sections of command-line.md on the site: the commands with their arguments, from the parsers."""

from __future__ import annotations

import argparse
from collections.abc import Container, Iterator
from typing import TypeAlias

from tools.figures.pages import DOCS, Texts

from inkloop.cli import parser
from inkloop.commands.options import add_output

PAGE = DOCS / "reference" / "command-line.md"
Row: TypeAlias = tuple[str, str]


def texts() -> Texts:
    """A section for each command, without the options that all commands have."""
    shared = argparse.ArgumentParser(add_help=False)
    add_output(shared)
    own = {action.dest for action in shared._actions}
    return {PAGE: {"commands": "".join(_section(*command, own) for command in _commands(parser()))}}


def _section(command: argparse.ArgumentParser, meaning: str, left_out: Container[str]) -> str:
    """Heading, meaning and arguments of a command."""
    rows = "".join(f"\n- {names}: {text}" for names, text in _rows(command, left_out))
    return f"\n## {command.prog}\n\n{meaning[0].upper()}{meaning[1:]}.\n{rows}\n"


def _commands(above: argparse.ArgumentParser) -> Iterator[tuple[argparse.ArgumentParser, str]]:
    """The parser of each command that takes arguments, and its help."""
    for action in above._actions:
        if isinstance(action, argparse._SubParsersAction):
            meanings = {choice.dest: str(choice.help) for choice in action._choices_actions}
            for name, command in action.choices.items():
                below = list(_commands(command))
                yield from below or [(command, meanings[name])]


def _rows(parser: argparse.ArgumentParser, left_out: Container[str]) -> Iterator[Row]:
    """An argument or option, as it is typed, and its help."""
    for action in parser._actions:
        if action.dest == "help" or action.dest in left_out:
            continue
        value = "" if action.nargs == 0 else str(action.metavar or "|".join(map(str, action.choices or ())))
        names = ", ".join(action.option_strings)
        yield f"`{f'{names} {value}'.strip()}`", str(action.help)
