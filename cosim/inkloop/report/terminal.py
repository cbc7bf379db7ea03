"""The terminal: lines, tables that fit into a narrow window, progress, and results as JSON.

Texts of users are shown literally: brackets in a title or label are no markup, control characters are escapes.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable, Iterator, Mapping
from typing import IO, Any

from rich import box
from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn, TimeRemainingColumn
from rich.segment import Segment
from rich.table import Column, Table
from rich.text import Text

from inkloop.report import shown, wrapped

__all__ = ["NumberTable", "Terminal", "number_table"]

FILE_WIDTH = 120
"""Columns of a text in a file or a pipe."""
BAR_FROM, NOTES_FROM = 70, 100
"""Least columns for a bar, and for notes next to it."""


class Terminal(Console):
    """Output of a command: standard output, or standard error if standard output is for JSON alone.

    verbose: also show messages of devices that are neither warning nor error; as_json: whether `result` writes.
    """

    def __init__(
        self,
        file: IO[str] | None = None,
        *,
        width: int | None = None,
        quiet: bool = False,
        verbose: bool = False,
        as_json: bool = False,
    ) -> None:
        stream = file or (sys.stderr if as_json else sys.stdout)
        columns = width or (None if stream.isatty() else FILE_WIDTH)
        super().__init__(
            file=stream,
            width=columns,
            quiet=quiet,
            markup=False,
            highlight=False,
            emoji=False,
            force_terminal=None if file is None else file.isatty(),  # FORCE_COLOR puts no colours into a file
            force_jupyter=False,  # in a notebook, rich would show in the cell what belongs in the file
        )
        self.verbose, self.as_json = verbose, as_json

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterator[Segment]:
        """All that is shown passes here, on its way to a terminal or a file."""
        for text, style, control in super().render(renderable, options):
            yield Segment(text if control else shown(text), style, control)

    def sentence(self, text: str, style: str | None = None) -> None:
        """Write a sentence, in a terminal broken between words; in a pipe or a file it is one line."""
        self.print(wrapped(text, self.width) if self.is_terminal else text, style=style, soft_wrap=True)

    def failures(self, sentences: Iterable[str]) -> None:
        """Print failures of a check if nothing else is shown (--quiet); on standard error, like errors."""
        if self.quiet:
            for sentence in sentences:
                print(shown(sentence), file=sys.stderr)

    def result(self, **data: Any) -> None:
        """Print the result of a command as JSON on standard output, if asked for; a number that is none is null."""
        if self.as_json:
            print(json.dumps(without_nan(data), indent=2, default=str))

    def progress(self, *notes: str, transient: bool = False) -> Progress:
        """A bar for each task, with the time left; notes: names of fields to show next to it, where there is room.

        transient: nothing of it stays on the screen, or gets into a file.
        """
        columns: list[ProgressColumn] = [
            TextColumn("{task.description}", markup=False, table_column=Column(no_wrap=True, overflow="ellipsis"))
        ]
        if self.width >= BAR_FROM:
            columns.append(BarColumn(10))
        shown = notes if self.width >= NOTES_FROM else notes[:1]
        columns += [TextColumn(f"{{task.fields[{name}]}}", markup=False, table_column=_fixed()) for name in shown]
        return Progress(
            *columns, TimeRemainingColumn(compact=True, table_column=_fixed()), console=self, transient=transient
        )


class NumberTable(Table):
    """A table between its title and its caption, which may be wider than the table."""

    def __init__(self, heading: str, note: str | None) -> None:
        super().__init__(box=box.SIMPLE_HEAD, show_edge=False, padding=0)
        self.heading, self.note = heading, note

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Each of the three in the whole width of the terminal."""
        yield Text(self.heading, style="table.title")
        yield from super().__rich_console__(console, options)
        if self.note:
            yield Text(self.note, style="table.caption")


def number_table(first: str, *numbers: str, title: str, caption: str | None = None) -> NumberTable:
    """A table whose first column is text that wraps; the numbers to the right of it are never cut.

    A heading may have several lines.
    """
    table = NumberTable(title, caption)
    table.add_column(first, overflow="fold")
    for heading in numbers:
        table.add_column(f" {heading}".replace("\n", "\n "), justify="right", no_wrap=True)
    return table


def decimals(value: float, count: int = 2) -> str:
    """The number with so many decimals; what rounds to zero has no sign."""
    return f"{round(value, count) + 0.0:.{count}f}"


def _fixed() -> Column:
    return Column(no_wrap=True)


def without_nan(value: Any) -> Any:
    """Plain values for JSON: a number that is none or endless becomes null."""
    if isinstance(value, Mapping):
        return {str(key): without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
