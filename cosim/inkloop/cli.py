"""The `inkloop` command."""

from __future__ import annotations

import argparse
import atexit
import gc
import os
import sys
from collections.abc import Container, Iterator, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, NoReturn

from inkloop.commands import bench, export, parts, prints, runs
from inkloop.commands.options import add_output, number, show_error, whole_number
from inkloop.commands.suggestions import suggestion
from inkloop.errors import InkloopError, message_of, near, nearest
from inkloop.files import reason_of
from inkloop.report import shown

COMMANDS = (*prints.PARTS, *runs.PARTS, *parts.PARTS, export, bench)
"""inkloop's own commands, in the order of `inkloop --help`; packages add others."""
RENAMED = {
    **{f"export-{part}": f"export {part}" for part in ("ssp", "job", "layers", "surface")},
    "schema": "export schema",
    "device": f"bench {'|'.join(bench.ACTIONS)}",
    "doctor": "bench doctor",
    "replay": "bench replay",
    "export": "export fmu",
    "bench": "bench emulate",
}
"""Command of version 0.1.0 -> its name now."""
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
    except (OSError, MemoryError) as error:
        place = getattr(error, "filename", None) or ("inkloop" if isinstance(error, MemoryError) else "a file")
        show_error(InkloopError(f"{place}: {reason_of(error)}"), options, error)
        return 1
    except KeyboardInterrupt as interrupt:
        notes = getattr(interrupt, "__notes__", [])
        print(shown(": ".join(["interrupted", *notes])), file=sys.stderr)
        return 130


def parser() -> argparse.ArgumentParser:
    """The parser of the whole command line, with the commands of all installed packages."""
    return _parser([])[0]


def _parsed(words: list[str]) -> argparse.Namespace:
    """The options of a command; ends the program with the usage of that command where they are wrong."""
    whole, commands = _parser(words)
    if not words:
        whole.error("name a command; `inkloop --help` lists them")
    _check_names(whole, commands, words)
    options, unknown = whole.parse_known_args(words, argparse.Namespace(words=words))
    if unknown:
        command = options.parser
        command.error(f"unknown arguments: {' '.join(unknown)}{suggestion(unknown, options)}")
    return options


def _check_names(whole: argparse.ArgumentParser, commands: Any, words: list[str]) -> None:
    """Ends the program where the words begin with no command, or with none of the parts of one."""
    above, below = whole, commands
    for word in words:
        if below is None or word.startswith("-"):
            return
        if word not in below.choices:
            if words[0] in RENAMED and (above is whole or not near(word, below.choices)):
                above.error(f"there is no command {word!r}; `inkloop {words[0]}` is now `inkloop {RENAMED[words[0]]}`")
            above.error(f"there is no command {word!r}; {nearest(word, below.choices)}")
        above = below.choices[word]
        below = above.get_default("parts")


def _parser(words: Sequence[str]) -> tuple[argparse.ArgumentParser, Any]:
    """The parser of the whole command line, and its commands: `choices` has a parser for each name.

    words: where they begin with a command of inkloop, those of other packages are not looked for.
    """
    whole = _Parser(
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
        _add(commands, module)
    if words[:1] != ["--version"] and not (words and words[0] in commands.choices):
        try:
            for module in _installed(words[0] if words else "", commands.choices):
                _add(commands, module)
        except InkloopError as error:
            whole.error(str(error))
    return whole, commands


def _add(commands: Any, module: Any) -> None:
    """Add the command of a module, with the parts of one that has some."""
    one: argparse.ArgumentParser = module.add_parser(commands)
    if parts := getattr(module, "PARTS", ()):
        below = one.add_subparsers(title="commands", required=True, metavar="COMMAND")
        for part in parts:
            _add(below, part)
        one.set_defaults(parts=below)
        return
    add_output(one)
    one.register("type", int, whole_number)
    one.register("type", float, number)
    one.set_defaults(command=module.run, parser=one)


class _Parser(argparse.ArgumentParser):
    """A parser that takes options in full only, and whose errors show control characters in file names as escapes.

    So are those of the commands below it.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(**options, allow_abbrev=False)

    def exit(self, status: int = 0, message: str | None = None) -> NoReturn:
        super().exit(status, message and shown(message))


class _Version(argparse.Action):
    """Prints the version; it is looked up only then."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        from inkloop import __version__

        print(f"inkloop {__version__}")
        parser.exit()


class _Completion(argparse.Action):
    """Prints a completion script for a shell."""

    def __call__(self, parser: argparse.ArgumentParser, namespace: Any, shell: Any, *_: Any) -> None:
        print(_script(parser, shell))
        parser.exit()


def _script(parser: argparse.ArgumentParser, shell: str) -> str:
    """The script for a shell. Arguments that are paths are completed to files, or to folders where metavar is DIR."""
    import shtab

    if shell not in shtab.SUPPORTED_SHELLS:
        parser.error(f"--print-completion {shell}: expected one of {', '.join(shtab.SUPPORTED_SHELLS)}")
    _mark_paths(parser)
    return shtab.complete(parser, shell)


def _mark_paths(parser: argparse.ArgumentParser) -> None:
    import shtab

    for action in parser._actions:  # argparse has no public way to them
        if isinstance(action, argparse._SubParsersAction):
            for command in set(action.choices.values()):
                _mark_paths(command)
        elif action.type is Path:
            action.complete = shtab.DIR if action.metavar == "DIR" else shtab.FILE  # type: ignore[attr-defined]


def _installed(word: str, taken: Container[str]) -> Iterator[Any]:
    """The commands of other packages, see `inkloop.commands`; only that of `word` where it names one.

    taken: names of inkloop's own commands, which no package replaces. A module that cannot be loaded is left out with a
    message; raises InkloopError where `word` names it.
    """
    found = {point.name: point for point in entry_points(group="inkloop.commands") if point.name not in taken}
    for name in [word] if word in found else sorted(found):
        try:
            yield found[name].load()
        except Exception as error:  # anything may go wrong in a package of others
            package = found[name].dist
            reason = f"the command {name} of {package.name if package else 'a package'} cannot be loaded"
            failure = InkloopError(f"{reason}: {message_of(error)}; update or uninstall that package")
            if name == word:
                raise failure from error
            print(f"inkloop: {failure}", file=sys.stderr)
