"""Errors of inkloop, grouped by who can fix the cause.

InkloopError
├── ScenarioError    the author of the file: every error of the file at once, each with its place
├── FmuError         the maker of an FMU: cannot be read, or lacks a required feature
├── ComponentError   a component failed while it ran: which one, when, in which layer
├── GeometryError    a part cannot be read from its file, or does not fit the grid
├── HeightMapError   a measured map cannot be read, or does not fit the grid as configured
└── ResultError      a run folder cannot be read or written
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

_PACKAGES = ("inkloop", "inkloop_controller", "inkloop_hardware", "inkloop_lab")


class InkloopError(Exception):
    """Anything that inkloop reports to the user as a message without a traceback."""


class ScenarioError(InkloopError):
    """Errors of one scenario; `errors` holds one sentence each: place, what was found, what is expected."""

    def __init__(self, source: str, errors: Sequence[str]) -> None:
        self.source = source
        self.errors = tuple(errors)
        count = "1 error" if len(self.errors) == 1 else f"{len(self.errors)} errors"
        super().__init__("\n".join([f"{source}: {count}", *(f"  - {error}" for error in self.errors)]))

    def __reduce__(self) -> tuple[type[ScenarioError], tuple[str, tuple[str, ...]]]:
        """Pickled whole, so that a process pool reports it instead of breaking."""
        return type(self), (self.source, self.errors)


class FmuError(InkloopError):
    """An FMU cannot be read, or lacks a required feature."""


class ComponentError(InkloopError):
    """A component refused a call or failed; the message names the component and the reason."""


class GeometryError(InkloopError):
    """A part cannot be read from its file or does not fit the grid; the message names the file."""


class HeightMapError(InkloopError):
    """A height map cannot be read or does not fit the grid; the message names the file."""


class ResultError(InkloopError):
    """A run folder cannot be read or written."""


def message_of(error: Exception) -> str:
    """The message of an InkloopError; for any other exception its type, message and line in the user's own code."""
    return str(error) if isinstance(error, InkloopError) else f"{type(error).__name__}: {error}{own_line(error)}"


def own_line(error: Exception) -> str:
    """The innermost line of the user's own code that an exception passed through, " (mine.py, line 12)"; "" if none.

    The user's own is what belongs neither to inkloop nor to an installed library.
    """
    import sysconfig
    import traceback

    libraries = {f"{Path(folder)}{os.sep}" for folder in sysconfig.get_paths().values()}
    place = ""
    for frame, line in traceback.walk_tb(error.__traceback__):
        file, module = frame.f_code.co_filename, str(frame.f_globals.get("__name__"))
        if not file.startswith((*libraries, "<")) and module.partition(".")[0] not in _PACKAGES:
            place = f" ({Path(file).name}, line {line})"
    return place
