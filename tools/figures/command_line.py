"""command-line.md: the commands with their arguments, from the parsers."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Container, Iterable, Iterator, Sequence
from typing import TypeAlias

from tools.figures.pages import DOCS, Texts

from inkloop.cli import parser
from inkloop.commands.options import add_output

PAGE = DOCS / "reference" / "command-line.md"
Row: TypeAlias = tuple[str, str]


def run() -> None:
    """Nothing: the texts come from the parsers."""


def texts() -> Texts:
    """A section for each command, the options that all commands have, and the arguments that several have."""
    shared = argparse.ArgumentParser(add_help=False)
    add_output(shared)
    own = {action.dest for action in shared._actions}
    commands = [(command.prog, meaning, list(_rows(command, own))) for command, meaning in _commands(parser())]
    count = Counter(row for *_, rows in commands for row in rows)
    often = [row for row, times in count.items() if times >= OFTEN]
    named = Counter(name for name, _ in often)
    often = [row for row in often if named[row[0]] == 1]
    return {
        PAGE: {
            "output": _listed(_rows(shared, set())),
            "often": _listed(often),
            "commands": "".join(_section(*command, often) for command in commands),
        }
    }


OFTEN = 2
"""Number of commands from which on the page explains an argument once."""


def _section(prog: str, meaning: str, rows: Sequence[Row], often: Sequence[Row]) -> str:
    """Heading, meaning and arguments of a command; of the arguments explained above the names alone."""
    own = [row for row in rows if row not in often]
    names = ", ".join(f"`{row[0].strip('`').replace(',', '').split()[0]}`" for row in rows if row in often)
    return f"\n## {prog}\n\n{_sentence(meaning)}{f' Takes {names}.' if names else ''}\n{_listed(own)}"


def _listed(rows: Iterable[Row]) -> str:
    """A line for each argument."""
    return "".join(f"\n- {names}: {meaning}" for names, meaning in rows) + "\n"


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


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."
