"""The `inkloop` command."""

from __future__ import annotations

import argparse
import atexit
import gc
import os
import re
import sys
from collections.abc import Sequence
from typing import Any

from inkloop.commands import (
    bench,
    compare,
    device,
    doctor,
    export,
    export_job,
    export_layers,
    export_ssp,
    export_surface,
    geometry,
    identify,
    info,
    metrology,
    new,
    replay,
    report,
    reproduce,
    resume,
    run,
    schema,
    score,
    sweep,
    validate,
    watch,
)
from inkloop.commands.options import add_output, number, show_error, whole_number
from inkloop.errors import InkloopError
from inkloop.files import reason_of

COMMANDS = (
    run,
    resume,
    validate,
    report,
    watch,
    compare,
    new,
    geometry,
    schema,
    export,
    export_ssp,
    export_job,
    export_layers,
    export_surface,
    info,
    metrology,
    reproduce,
    score,
    sweep,
    identify,
    bench,
    device,
    doctor,
    replay,
)
"""The modules of the commands, in the order of `inkloop --help`."""
EXIT_CODES = (
    "exit codes: 0 done; 1 an error, or a check that failed; 2 wrong arguments; 3 prints of a sweep failed; "
    "4 the print was stopped, as the scans do not show what was printed; 130 interrupted with Ctrl-C"
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code, see EXIT_CODES."""
    atexit.register(gc.freeze)  # searching all imported objects for garbage takes half a second and finds nothing
    options = _parsed(list(sys.argv[1:] if arguments is None else arguments))
    try:
        return int(options.command(options))
    except InkloopError as error:
        show_error(error, options)
        return 1
    except BrokenPipeError:  # the reader, `head` for example, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        show_error(InkloopError(f"{error.filename or 'a file'}: {reason_of(error)}"), options, error)
        return 1
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130


def parser() -> argparse.ArgumentParser:
    """The parser of the whole command line."""
    return _parser()[0]


def _parsed(words: list[str]) -> argparse.Namespace:
    """The options of a command; ends the program with the usage of that command where they are wrong."""
    whole, commands = _parser()
    if not words:
        whole.error("name a command; `inkloop --help` lists them")
    if not words[0].startswith("-") and words[0] not in commands.choices:
        from inkloop.suggest import nearest

        whole.error(f"there is no command {words[0]!r}; {nearest(words[0], commands.choices)}")
    options, unknown = whole.parse_known_args(words, argparse.Namespace(words=words))
    if unknown:
        command = commands.choices[options.command_name]
        command.error(f"unknown arguments: {' '.join(unknown)}{_suggestion(unknown, command.format_help())}")
    return options


def _suggestion(unknown: Sequence[str], shown: str) -> str:
    """The options of a help text that are nearest to unknown ones; "" if none is alike."""
    from inkloop.suggest import near

    options = set(re.findall(r"--[a-z][a-z-]*", shown))
    words = (word.partition("=")[0] for word in unknown if word.startswith("-"))
    close = sorted({option for word in words for option in near(word, options)})
    return f"; did you mean {' or '.join(close)}?" if close else ""


def _parser() -> tuple[argparse.ArgumentParser, Any]:
    """The parser of the whole command line, and its commands: `choices` has a parser for each name."""
    whole = argparse.ArgumentParser(
        prog="inkloop", description="Closed-loop ink-jet 3D printing as a co-simulation.", epilog=EXIT_CODES
    )
    whole.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    whole.add_argument(
        "--print-completion",
        action=_Completion,
        metavar="SHELL",
        help="print a completion script for bash, zsh, fish, tcsh or powershell and exit",
    )
    commands = whole.add_subparsers(title="commands", required=True, metavar="COMMAND", dest="command_name")
    for module in COMMANDS:
        one = module.add_parser(commands)
        add_output(one)
        one.register("type", int, whole_number)
        one.register("type", float, number)
        one.set_defaults(command=module.run)
    return whole, commands


class _Version(argparse.Action):
    """Prints the version; it is looked up only then."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        from inkloop import __version__

        print(f"inkloop {__version__}")
        parser.exit()


class _Completion(argparse.Action):
    """Prints a completion script for a shell."""

    def __call__(self, parser: argparse.ArgumentParser, namespace: Any, shell: Any, *_: Any) -> None:
        from inkloop.commands.completion import script

        print(script(parser, shell))
        parser.exit()
