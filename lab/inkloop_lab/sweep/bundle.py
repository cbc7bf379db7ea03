"""A scenario together with the files that it names, so that it can be printed elsewhere."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from inkloop.errors import ResultError
from inkloop.files import TomlError, read_toml_text, reason_of, toml_tables, write_text
from inkloop.units import MEGA

BYTES_MAX = 256 * int(MEGA)
"""Of all files of a scenario; larger ones belong where all machines see them, named by their whole path."""


@dataclass(frozen=True)
class Bundle:
    """A scenario's text, its place among its files, and what is in them.

    Files named by a path from the root stay where they are. Modules of classes next to the scenario are among them.
    """

    text: str
    place: str
    files: Mapping[str, bytes]

    @classmethod
    def of(cls, text: str, source: Path, values: Iterable[Any] = ()) -> Bundle:
        """The files that a scenario text, or one of these values of its keys, names. Raises ResultError."""
        folder = source.parent.resolve()
        named = {path for name in _texts([toml_tables(text), *values]) for path in _files_of(name, folder)}
        files = sorted(named)
        root = Path(os.path.commonpath([folder, *(path.parent for path in files)]))
        try:
            size = sum(path.stat().st_size for path in files)
            if size > BYTES_MAX:
                raise ResultError(
                    f"{source}: its files have {size / MEGA:.0f} MB, of at most {BYTES_MAX / MEGA:.0f}; put large ones "
                    "where all machines see them, and name them by their whole path"
                )
            content = {path.relative_to(root).as_posix(): path.read_bytes() for path in files}
        except OSError as error:
            raise ResultError(f"{error.filename}: cannot be read: {reason_of(error)}") from error
        return cls(text, (folder / source.name).relative_to(root).as_posix(), content)

    @property
    def sha256(self) -> str:
        """Of the text and of all files with their places."""
        found = hashlib.sha256(json.dumps([self.text, self.place]).encode())
        for name, content in sorted(self.files.items()):
            found.update(json.dumps([name, hashlib.sha256(content).hexdigest()]).encode())
        return found.hexdigest()

    def write(self, folder: Path) -> Path:
        """Write scenario and files into a folder; the scenario. Raises OSError."""
        for name, content in self.files.items():
            path = folder / PurePosixPath(name)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        scenario = folder / PurePosixPath(self.place)
        write_text(scenario, self.text)
        return scenario


def _texts(value: Any) -> Iterator[str]:
    """All texts in tables and lists."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for each in value.values():
            yield from _texts(each)
    elif isinstance(value, list | tuple):
        for each in value:
            yield from _texts(each)


def _files_of(name: str, folder: Path) -> Iterator[Path]:
    """Files that a text names relative to a folder: a file, what that names itself, a folder's, or a class's."""
    module, colon, _ = name.partition(":")
    if colon and module.replace(".", "").isidentifier():
        first = module.partition(".")[0]
        if (folder / f"{first}.py").is_file():
            yield from folder.glob("*.py")  # modules next to it may be imported by it
        if (folder / first / "__init__.py").is_file():
            yield from (folder / first).rglob("*.py")
        return
    if not name or len(name) > 255 or "\n" in name or "\0" in name or Path(name).is_absolute():
        return
    path = (folder / name).resolve()
    if path.is_dir() and path != folder and folder not in path.parents:
        return  # ".." and the like: no file of a scenario
    if path.is_dir() and path != folder:
        yield from (each for each in path.rglob("*") if each.is_file())
    elif path.is_file():
        yield path
        yield from _named_in(path)


def _named_in(path: Path) -> Iterator[Path]:
    """Files that a manifest names relative to itself."""
    if path.suffix not in (".toml", ".json"):
        return
    try:
        tables = toml_tables(read_toml_text(path)) if path.suffix == ".toml" else json.loads(path.read_text("utf-8"))
    except (OSError, TomlError, ValueError):
        return  # an error of the scenario that names it
    for name in _texts(tables):
        found = path.parent / name if name and len(name) < 256 and "\0" not in name else path
        if found != path and not Path(name).is_absolute() and found.is_file():
            yield found.resolve()
