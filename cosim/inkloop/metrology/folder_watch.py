"""Files written by another program: their numbered names, the expected file, the detection that it is complete."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from inkloop.limits import filled

Complete: TypeAlias = Literal["stable", "renamed", "done"]
"""Criteria of a complete file.

"stable": its size and time have not changed for a while; "renamed": it appears under its name only when it is, as
programs do that write to a temporary name; "done": a file of its name and .done is next to it.
"""

POLL_S = 0.05
FIELD = "layer"
"""Field of a file name that holds the number of the layer."""


def name_errors(key: str, template: str, field: str, example: str) -> list[str]:
    """Errors of the template of a file name, one sentence each; key: which the scenario gives it by."""
    expected = f"expected a name of its own for each layer, such as {example!r}"
    try:
        names = {filled(template, {field: number}) for number in (1, 2, 30)}
    except ValueError as error:
        return [f"{key} is {template!r} ({error}); {expected}"]
    if len(names) < 3 or any(Path(name).name != name for name in names):
        return [f"{key} is {template!r}; {expected}"]
    return []


def numbered_files(folder: Path, template: str, field: str) -> dict[int, Path]:
    """Number -> file, of all files in the folder that have the name of a number. Raises OSError."""
    number = re.compile(r"\d+")
    found: dict[int, Path] = {}
    for path in folder.iterdir():
        numbers = map(int, number.findall(path.name))
        found |= {each: path for each in numbers if filled(template, {field: each}) == path.name}
    return found


@dataclass(frozen=True)
class _Sight:
    size: int
    modified_ns: int
    since: float


@dataclass
class Wait:
    """A layer that is awaited since a time of the clock [s], and the wait after which it is reported next [s]."""

    layer: int
    since: float
    next_word_s: float = 2.0


class FolderWatch:
    """Looks for the file of a layer, `file_name` with the number of the layer, in `folder`.

    settle_s: how long a "stable" file has to be unchanged. clock: monotonic [s]; sleep: waits that many seconds.
    """

    def __init__(
        self,
        folder: Path,
        file_name: str,
        complete: Complete,
        settle_s: float,
        *,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.folder = folder
        self._file_name, self._complete, self._settle_s = file_name, complete, settle_s
        self.clock, self._sleep = clock, sleep
        self._sights: dict[Path, _Sight] = {}

    def path(self, layer: int) -> Path:
        """Path of the file of a layer."""
        return self.folder / filled(self._file_name, {FIELD: layer})

    def look(self, layer: int, patience_s: float) -> Path | None:
        """The file of a layer if it is complete; waits up to `patience_s` for it, and for an existing one to settle.

        Raises OSError if the folder cannot be read.
        """
        path, end = self.path(layer), self.clock() + patience_s
        while not self._is_complete(path):
            sight = self._sights.get(path)
            if self.clock() >= (end if sight is None else max(end, sight.since + self._settle_s)):
                return None
            self._sleep(min(POLL_S, self._settle_s) or POLL_S)
        return path

    def is_in_sight(self, layer: int) -> bool:
        """Whether the file exists, complete or not."""
        return self.path(layer).exists()

    def layers(self) -> dict[int, Path]:
        """Layer -> file, of all files in the folder that have the name of a layer."""
        return numbered_files(self.folder, self._file_name, FIELD)

    def _is_complete(self, path: Path) -> bool:
        try:
            state = path.stat()
        except FileNotFoundError:
            self._sights.pop(path, None)
            return False
        if self._complete == "renamed":
            return True
        if self._complete == "done":
            return path.with_name(f"{path.name}.done").exists()
        sight = self._sights.get(path)
        if sight is None or (sight.size, sight.modified_ns) != (state.st_size, state.st_mtime_ns):
            self._sights[path] = _Sight(state.st_size, state.st_mtime_ns, self.clock())
            return False
        return state.st_size > 0 and self.clock() - sight.since >= self._settle_s
