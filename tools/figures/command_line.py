"""command-line.md: the commands with their arguments, from the parsers."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from tools.figures.pages import DOCS, Texts, table

from inkloop.cli import COMMANDS
from inkloop.commands.options import add_output

PAGE = DOCS / "reference" / "command-line.md"


def run() -> None:
    """Nothing: the texts come from the parsers."""


def texts() -> Texts:
    """A section for each command, and the options that all commands have."""
    commands = argparse.ArgumentParser(prog="inkloop").add_subparsers()
    shared = argparse.ArgumentParser(add_help=False)
    add_output(shared)
    sections = []
    for module in COMMANDS:
        parser = module.add_parser(commands)
        meaning = next(action.help for action in commands._choices_actions if parser.prog.endswith(action.dest))
        sections.append(f"\n## {parser.prog}\n\n{_sentence(str(meaning))}\n{table(HEADS, _rows(parser))}")
    return {PAGE: {"output": table(HEADS, _rows(shared)), "commands": "".join(sections)}}


HEADS = ("argument", "meaning")


def _rows(parser: argparse.ArgumentParser) -> Iterator[tuple[str, str]]:
    """An argument or option, as it is typed, and its help."""
    for action in parser._actions:
        if action.dest == "help":
            continue
        value = "" if action.nargs == 0 else str(action.metavar or "|".join(map(str, action.choices or ())))
        names = ", ".join(action.option_strings)
        yield f"`{f'{names} {value}'.strip()}`".replace("|", r"\|"), str(action.help).replace("|", r"\|")


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."
