"""Tables and pictures of a run folder.

Here stands what commands use before they load any of it: formats of pictures, and sentences that fit into a window.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence

from inkloop.errors import InkloopError

PNG = "png"
FORMATS = (PNG, "svg", "pdf")
_KEPT = "\0"
_HIDDEN = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
"""Characters that a terminal obeys, that turn the direction of a text, or that are half a character (file names)."""
_QUOTED = re.compile(r"`[^`\n]*`")


def picture_formats(names: Sequence[str]) -> tuple[str, ...]:
    """The formats, each once, in the order given. Raises InkloopError for one that pictures do not have."""
    unknown = [name for name in names if name not in FORMATS]
    if unknown:
        found = ", ".join(repr(name) for name in unknown)
        raise InkloopError(f"there is no picture format {found}; expected {', '.join(FORMATS)}, or several with commas")
    return tuple(dict.fromkeys(names))


def shown(text: str) -> str:
    """The text with control characters but newlines and tabs as escapes: "\\x1b"."""
    return _HIDDEN.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


def wrapped(text: str, columns: int) -> str:
    """The text broken between words into lines of at most so many columns; `commands in backquotes` stay whole.

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
