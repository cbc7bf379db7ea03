"""The file formats of pictures, and how a user names them."""

from __future__ import annotations

from collections.abc import Sequence

from inkloop.errors import InkloopError

PNG = "png"
FORMATS = (PNG, "svg", "pdf")


def picture_formats(names: Sequence[str]) -> tuple[str, ...]:
    """The formats, each once, in the order given. Raises InkloopError for one that pictures do not have."""
    unknown = [name for name in names if name not in FORMATS]
    if unknown:
        found = ", ".join(repr(name) for name in unknown)
        raise InkloopError(f"there is no picture format {found}; expected {', '.join(FORMATS)}, or several with commas")
    return tuple(dict.fromkeys(names))
