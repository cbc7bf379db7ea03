"""command-line.md: the commands with their arguments, from the parsers."""

from __future__ import annotations

import argparse
from collections.abc import Container, Iterator

from tools.figures.pages import DOCS, Texts, table

from inkloop.cli import parser
from inkloop.commands.options import add_output

PAGE = DOCS / "reference" / "command-line.md"


def run() -> None:
    """Nothing: the texts come from the parsers."""


def texts() -> Texts:
    """A section for each command, and the options that all commands have."""
    shared = argparse.ArgumentParser(add_help=False)
    add_output(shared)
    own = {action.dest for action in shared._actions}
    sections = [
        f"\n## {command.prog}\n\n{_sentence(meaning)}\n{table(HEADS, _rows(command, own))}"
        for command, meaning in _commands(parser())
    ]
    return {PAGE: {"output": table(HEADS, _rows(shared, set())), "commands": "".join(sections)}}


HEADS = ("argument", "meaning")


def _commands(above: argparse.ArgumentParser) -> Iterator[tuple[argparse.ArgumentParser, str]]:
    """The parser of each command that takes arguments, and its help."""
    for action in above._actions:
        if isinstance(action, argparse._SubParsersAction):
            meanings = {choice.dest: str(choice.help) for choice in action._choices_actions}
            for name, command in action.choices.items():
                below = list(_commands(command))
                yield from below or [(command, meanings[name])]


def _rows(parser: argparse.ArgumentParser, left_out: Container[str]) -> Iterator[tuple[str, str]]:
    """An argument or option, as it is typed, and its help."""
    for action in parser._actions:
        if action.dest == "help" or action.dest in left_out:
            continue
        value = "" if action.nargs == 0 else str(action.metavar or "|".join(map(str, action.choices or ())))
        names = ", ".join(action.option_strings)
        yield f"`{f'{names} {value}'.strip()}`".replace("|", r"\|"), str(action.help).replace("|", r"\|")


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."
