"""Options that several commands share: a scenario with overrides, the file of a part, a subprocess, platforms."""

from __future__ import annotations

import argparse
import shutil
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from inkloop.errors import InkloopError, ScenarioError, decimal_comma, missing
from inkloop.report import FORMATS, PNG, picture_formats, shown, wrapped

if TYPE_CHECKING:
    from inkloop.report.terminal import Terminal
    from inkloop.scenario.file import Scenario

__all__ = ["add_overrides", "add_pictures", "formats_of", "overrides_of", "screen"]


def add_scenario(parser: argparse.ArgumentParser) -> None:
    """SCENARIO, --job and --set; `scenario_of` reads them."""
    parser.add_argument(
        "scenario",
        type=Path,
        metavar="SCENARIO",
        help="scenario file (.toml), name of one of inkloop (`inkloop new --list`), or system of FMUs (.ssp)",
    )
    parser.add_argument(
        "--job", type=Path, metavar="FILE", help="scenario to combine with the .ssp (default: the one embedded in it)"
    )
    add_overrides(parser)


def add_overrides(
    parser: argparse.ArgumentParser, of: str = "override a key, e.g. components.controller.alpha=0.5"
) -> None:
    """--set, which may be repeated; `overrides_of` reads it."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        dest="overrides",
        help=f"{of}; may be repeated",
    )


def add_isolate(parser: argparse.ArgumentParser) -> None:
    """--isolate and --no-isolate."""
    parser.add_argument(
        "--isolate",
        action=argparse.BooleanOptionalAction,
        help="print in a subprocess, so that a crashing FMU yields an error message "
        "(default: if a component is an FMU that is not part of inkloop)",
    )


def add_pictures(parser: argparse.ArgumentParser, default: Sequence[str] | None = (PNG,)) -> None:
    """--pictures and --no-pictures: the formats to write, none with the latter."""
    pictures = parser.add_mutually_exclusive_group()
    pictures.add_argument(
        "--pictures",
        type=_formats,
        default=default,
        metavar="FORMAT,...",
        help=f"formats of the pictures: {', '.join(FORMATS)} (default: {PNG})",
    )
    pictures.add_argument("--no-pictures", action="store_const", const=(), dest="pictures", help="write no pictures")


def formats_of(options: argparse.Namespace) -> tuple[str, ...]:
    """The formats asked for, else the one that the suffix of --out names, PNG without one. Raises InkloopError.

    None, and a line on the screen, where Matplotlib is not installed.
    """
    formats = options.pictures
    if formats is None:
        formats = picture_formats([options.out.suffix.removeprefix(".") if options.out and options.out.suffix else PNG])
    if formats and (reason := missing("matplotlib", "a picture")):
        screen(options).sentence(f"no pictures are written: {reason}")
        return ()
    return tuple(formats)


def _formats(text: str) -> tuple[str, ...]:
    try:
        return picture_formats([name.strip() for name in text.split(",")])
    except InkloopError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def add_platforms(parser: argparse.ArgumentParser) -> None:
    """--platforms of the commands that write FMUs."""
    parser.add_argument(
        "--platforms",
        type=lambda text: tuple(name.strip() for name in text.split(",")),
        metavar="NAME,...",
        help="binaries of inkloop's FMUs: x86_64-linux, aarch64-linux, x86_64-windows, aarch64-windows, x86_64-darwin, "
        "aarch64-darwin, or all; missing ones are compiled by ziglang (default: those of the installed FMUs)",
    )


def is_isolated(options: argparse.Namespace, scenario: Scenario) -> bool:
    """Whether to print in a subprocess: as chosen, else if a component runs an FMU of others."""
    return bool(scenario.foreign_fmus) if options.isolate is None else bool(options.isolate)


@contextmanager
def scenario_of(options: argparse.Namespace) -> Iterator[Scenario]:
    """The scenario of the command line. Classes next to it may be its components. Raises ScenarioError."""
    from inkloop.scenario.file import Scenario
    from inkloop.scenario.packaged import classes_from

    path: Path = options.scenario
    job: Path | None = getattr(options, "job", None)
    overrides = overrides_of(options.overrides, str(path))
    with classes_from((job or path).parent):
        if path.suffix == ".ssp":
            from inkloop.exchange.ssp import reading

            yield reading.scenario_of(path, overrides, job)
        elif job is not None:
            raise ScenarioError(str(path), [f"--job {job}: --job goes with an .ssp; leave it out"])
        else:
            yield Scenario.load(path, overrides)


def overrides_of(pairs: Iterable[str], source: str) -> dict[str, Any]:
    """The values of repeated --set options by key; a value that is not TOML is text. Raises ScenarioError."""
    import tomlkit
    from tomlkit.exceptions import TOMLKitError

    overrides: dict[str, Any] = {}
    errors = []
    for pair in pairs:
        key, separator, text = (piece.strip() for piece in pair.partition("="))
        if not separator or not all(name.strip() for name in key.split(".")):
            errors.append(f"--set {pair}: expected KEY=VALUE, e.g. --set components.controller.alpha=0.5")
            continue
        try:
            overrides[key] = tomlkit.value(text)
        except TOMLKitError:
            overrides[key] = text
            if advice := decimal_comma(text):
                errors.append(f"--set {pair}: {advice}; a list has brackets, a text quotes")
    if errors:
        raise ScenarioError(source, errors)
    return overrides


def _reader(kind: Callable[[str], float], expected: str) -> Callable[[str], float]:
    """A reader of an option that says what it expects."""

    def read(text: str) -> float:
        try:
            return kind(text)
        except ValueError as error:
            advice = (kind is float and decimal_comma(text)) or f"expected {expected}"
            raise argparse.ArgumentTypeError(f"is {text!r}; {advice}") from error

    return read


number = _reader(float, "a number, without a unit")
whole_number = _reader(int, "a whole number")


def add_output(parser: argparse.ArgumentParser) -> None:
    """--quiet, --verbose, --json and --traceback, which every command has."""
    output = parser.add_argument_group("output")
    amount = output.add_mutually_exclusive_group()
    amount.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors")
    amount.add_argument("-v", "--verbose", action="store_true", help="also print every message of devices")
    output.add_argument("--json", action="store_true", help="print the result as JSON; the rest goes to standard error")
    output.add_argument("--traceback", action="store_true", help="print the Python traceback of an error")


def screen(options: argparse.Namespace) -> Terminal:
    """The terminal as the options of `add_output` ask for it."""
    from inkloop.report.terminal import Terminal

    return Terminal(quiet=options.quiet, verbose=options.verbose, as_json=options.json)


def show_written(options: argparse.Namespace, path: Path) -> int:
    """Show that a file was written; the exit code."""
    terminal = screen(options)
    terminal.sentence(f"wrote {path}")
    terminal.result(file=path)
    return 0


def show_error(error: InkloopError, options: argparse.Namespace, raised: Exception | None = None) -> None:
    """Print the message of an error on stderr; with --traceback, below the calls that led to it and to its causes.

    With --json the errors are printed as JSON too. raised: the original error that this one replaces.
    """
    if options.json:
        screen(options).result(errors=list(error.errors) if isinstance(error, ScenarioError) else [str(error)])
    if options.traceback:
        text = "".join(traceback.format_exception(raised or error)).rstrip("\n")
    else:
        text = wrapped(str(error), shutil.get_terminal_size().columns) if sys.stderr.isatty() else str(error)
    print(shown(text), file=sys.stderr)
