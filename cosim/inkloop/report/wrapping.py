"""Break sentences between words where a window ends; `commands in backquotes` stay whole, to be copied."""

from __future__ import annotations

import re
import textwrap

_KEPT = "\0"
_QUOTED = re.compile(r"`[^`\n]*`")


def wrapped(text: str, columns: int) -> str:
    """The text with lines of at most so many columns, words and quoted commands longer than that aside.

    Lines that continue an item ("  - ...") or an indented line begin below its text.
    """
    return "\n".join(_lines(line, columns) for line in text.split("\n"))


def _lines(line: str, columns: int) -> str:
    if len(line) <= columns:
        return line
    indent = len(line) - len(line.lstrip(" "))
    hanging = " " * (indent + 2 * line.startswith("- ", indent))
    kept = _QUOTED.sub(lambda found: found[0].replace(" ", _KEPT), line.strip(" "))
    broken = textwrap.wrap(
        kept,
        columns,
        initial_indent=" " * indent,
        subsequent_indent=hanging,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return "\n".join(broken).replace(_KEPT, " ")
