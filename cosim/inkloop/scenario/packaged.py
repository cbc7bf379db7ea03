"""Places: scenarios that are installed with inkloop, by name, and classes that a scenario names as "module:Class"."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from inkloop.errors import ScenarioError, near
from inkloop.files import read_toml_text

__all__ = ["classes_from"]

PACKAGE = "inkloop.scenarios"


def scenarios() -> dict[str, Path]:
    """Name -> file, sorted; empty where the package is not installed."""
    package = importlib.util.find_spec(PACKAGE)
    folders = [Path(place) for place in (package.submodule_search_locations or [])] if package else []
    return {path.stem: path for folder in folders for path in sorted(folder.glob("*.toml"))}


def titles() -> dict[str, str]:
    """Name -> title of each scenario."""
    import tomlkit

    return {name: str(tomlkit.parse(read_toml_text(path)).get("title", "")) for name, path in scenarios().items()}


def resolve(path: Path) -> Path:
    """The path itself, or the packaged scenario of that name if there is no such file and the path has no suffix.

    Raises ScenarioError for a name that is neither.
    """
    if path.suffix or len(path.parts) != 1 or path.exists():
        return path
    known = scenarios()
    if path.name in known:
        return known[path.name]
    beside = path.with_name(f"{path.name}.toml")
    close = [str(beside)] if beside.is_file() else near(path.name, known)
    meant = f"did you mean {' or '.join(close)}? " if close else ""
    reason = f"is neither a file nor a scenario of inkloop; {meant}`inkloop new --list` lists them"
    raise ScenarioError(str(path), [reason])


@contextmanager
def classes_from(folder: Path) -> Iterator[None]:
    """Within the block a kind "module:Class" is also looked for in `folder`."""
    place = str(folder.resolve())
    if place in sys.path:
        yield
        return
    sys.path.append(place)
    try:
        yield
    finally:
        sys.path.remove(place)
