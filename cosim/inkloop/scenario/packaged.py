"""Places: scenarios that are installed with inkloop, by name, and classes that a scenario names as "module:Class"."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from inkloop.files import read_toml_text
from inkloop.suggest import near

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
    """The packaged scenario whose name `path` is, if there is no such file and no suffix; else the path itself."""
    if path.suffix or len(path.parts) != 1 or path.exists():
        return path
    return scenarios().get(path.name, path)


def hint(path: Path) -> str | None:
    """Advice for a name without a suffix that is neither a file nor a packaged scenario; None for a file."""
    if path.suffix or len(path.parts) != 1 or path.exists():
        return None
    beside = path.with_name(f"{path.name}.toml")
    close = [str(beside)] if beside.is_file() else near(path.name, scenarios())
    meant = f"did you mean {' or '.join(close)}? " if close else ""
    return f"is neither a file nor a scenario of inkloop; {meant}`inkloop new --list` lists them"


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
