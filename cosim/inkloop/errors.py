"""Errors of inkloop, grouped by who can fix the cause.

InkloopError
├── ScenarioError    the author of the file: every error of the file at once, each with its place
├── FmuError         the maker of an FMU: cannot be read, or lacks a required feature
├── ComponentError   a component failed while it ran: which one, when, in which layer
├── GeometryError    a part cannot be read from its file, or does not fit the grid
├── HeightMapError   a measured map cannot be read, or does not fit the grid as configured
└── ResultError      a run folder cannot be read or written

`require` raises one for a package that a base installation lacks.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from types import ModuleType

_PACKAGES = ("inkloop", "inkloop_controller", "inkloop_hardware", "inkloop_lab")
EXTRAS: Mapping[str, tuple[str, str]] = {
    "contourpy": ("contourpy", "report"),
    "distributed": ("distributed", "dask"),
    "gymnasium": ("gymnasium", "env"),
    "lib3mf": ("lib3mf", "3mf"),
    "matplotlib": ("matplotlib", "report"),
    "odxtools": ("odxtools", "formats"),
    "optuna": ("optuna", "optimise"),
    "PIL": ("pillow", "formats"),
    "plotly": ("plotly", "report"),
    "pyopencl": ("pyopencl", "gpu"),
    "sdfio": ("sdfio", "formats"),
    "skfem": ("scikit-fem", "reproduce"),
    "SurfaceTopography": ("SurfaceTopography", "metrology"),
    "tifffile": ("tifffile", "formats"),
    "trimesh": ("trimesh", "formats"),
    "ziglang": ("ziglang", "cross"),
}
"""Module -> its package and the extra that brings it."""


class InkloopError(Exception):
    """Anything that inkloop reports to the user as a message without a traceback."""

    has_own_remedy = False
    """Whether the message gives its own remedy: the general advice to resume is then left out."""

    @property
    def remedy_is_said(self) -> bool:
        """Whether it, or the error that caused it, has its own remedy."""
        cause = self.__cause__
        return self.has_own_remedy or (isinstance(cause, InkloopError) and cause.remedy_is_said)


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


def missing(module: str, user: str) -> str:
    """A sentence with `user` as its subject, if the module cannot be imported: its package, and how to install it."""
    package, extra = EXTRAS[module]
    try:
        import_module(module)
    except ImportError as error:
        reason = "" if error.name == module else f" ({error})"
        return f"{user} needs the package {package}{reason}: pip install 'inkloop[{extra}]'"
    return ""


def require(module: str, user: str, error: type[InkloopError] = InkloopError) -> ModuleType:
    """The module. Raises `error` with the sentence of `missing`."""
    if reason := missing(module, user):
        raise error(reason)
    return import_module(module)


def damaged(path: Path) -> str:
    """A sentence on a file that the library of its format cannot read; the library's own words are of no help."""
    found = f"is damaged, or its suffix is wrong: it cannot be read as {path.suffix}"
    return f"{path}: {found}; write it again, or correct the suffix (--traceback shows where reading failed)"


def message_of(error: BaseException) -> str:
    """The message of an InkloopError; for any other exception its type, message and line in the user's own code."""
    return str(error) if isinstance(error, InkloopError) else f"{type(error).__name__}: {error}{own_line(error)}"


def own_line(error: BaseException) -> str:
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


_WITH_COMMA = re.compile(r"[+-]?\d+,\d+")


def decimal_comma(text: str) -> str:
    """Advice on a text that is a number with a decimal comma; "" on any other text."""
    return f"a number has a point, no comma: {text.replace(',', '.')}" if _WITH_COMMA.fullmatch(text) else ""


OFFERED_MAX = 3  # more words than this are alike by chance
SHORT = 3  # letters of a word in which one wrong letter is already a third


def nearest(found: str, known: Iterable[str], listed: Iterable[str] | None = None) -> str:
    """Suggestion instead of `found`: the nearest known words that are equally near, else all, or `listed`."""
    words = sorted(known)
    if close := near(found, words):
        return f"did you mean {' or '.join(close[:OFFERED_MAX])}?"
    return f"known: {', '.join(words if listed is None else sorted(listed)) or 'none'}"


def near(found: str, known: Iterable[str]) -> list[str]:
    """The nearest known words, all that are equally near; none where nothing is alike."""
    import difflib  # other commands start without it

    words = sorted(known)
    alike = {word: difflib.SequenceMatcher(None, word, found).ratio() for word in words}
    limit = 0.5 if len(found) <= SHORT else 0.6
    return [word for word in words if alike[word] >= max(limit, *alike.values())]
