"""One print of a study: what it is to print, with the files that the scenario names, and the record that is left of it.

`perform` runs in a process or on a machine of its own. It knows no other print, and what it returns is all that there
is of the print, but for its run folder where runs are kept.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.errors import ResultError, ScenarioError, message_of
from inkloop.files import TomlError, read_toml_text, reason_of, toml_tables, write_text
from inkloop.printing.run import origin_of, print_part
from inkloop.results import checkpoint
from inkloop.results.lock import sole_writer, writer_of
from inkloop.results.result import RUN_FILE, STOPPED, UNFINISHED, Result, read_record
from inkloop.scenario.file import Scenario
from inkloop.scenario.packaged import classes_from
from inkloop.units import MEGA

FAILED, INTERRUPTED = "failed", "interrupted"
OWNER_S = 10.0
"""For a process to end whose study was killed."""


@dataclass(frozen=True)
class Task:
    """A point of a study with a seed. replicate: which of the seeds of the point it is, from 0."""

    point: int
    replicate: int
    seed: int
    overrides: Mapping[str, Any]

    @property
    def key(self) -> tuple[int, int]:
        """Identity of the task within its study."""
        return self.point, self.replicate


@dataclass(frozen=True, eq=False)
class Record:
    """Outcome of a print. status: its stop reason, or failed; metrics [m]; height: last surface (x, y) [m]."""

    point: int
    replicate: int
    status: str
    metrics: Mapping[str, float] = field(default_factory=dict)
    wall_s: float = float("nan")
    error: str = ""
    height: NDArray[np.float64] | None = None

    @property
    def key(self) -> tuple[int, int]:
        """That of its task."""
        return self.point, self.replicate


@dataclass(frozen=True)
class Order:
    """Inputs common to all prints of a study.

    text, source: of the scenario; runs: folder of the run folders of prints, None: they are printed in memory;
    with_height: the last surface goes into the record.
    """

    text: str
    source: str
    runs: str | None
    with_height: bool


def name_of(key: tuple[int, int]) -> str:
    """The name of a print in the folder of its study: of its record, its run folder and its map."""
    point, replicate = key
    return f"{point:05d}-{replicate:04d}"


def failed(task: Task, message: str) -> Record:
    """The record of a print that failed."""
    return Record(task.point, task.replicate, FAILED, error=message)


def perform(order: Order, task: Task) -> Record:
    """Print a task, or resume it after its last layer; a print that fails leaves a record with its error.

    Raises ResultError where the run folder cannot be written: that is no error of the point.
    """
    try:
        with classes_from(Path(order.source).parent):
            scenario = Scenario.of_text(order.text, order.source, {**task.overrides, "seed": task.seed})
            result = _printed(scenario, Path(order.runs, name_of(task.key))) if order.runs else print_part(scenario)
    except ResultError:
        raise
    except ScenarioError as error:  # without the place of the file, which differs on a cluster
        return failed(task, "\n".join(error.errors))
    except (OSError, MemoryError) as error:
        raise ResultError(f"print {name_of(task.key)}: {reason_of(error)}") from error
    except Exception as error:  # of a scenario, a component, or anything in a class of others
        cause = error.__cause__ if order.runs and isinstance(error.__cause__, type(error)) else error
        return failed(task, message_of(cause if isinstance(cause, Exception) else error))
    height = np.array(result.final_height.values, np.float64) if order.with_height else None
    return Record(task.point, task.replicate, result.stop_reason, result.metrics(), result.wall_s, "", height)


def _printed(scenario: Scenario, folder: Path) -> Result:
    """The result of a run folder, which is begun, resumed, or only read where it is finished."""
    end = time.monotonic() + OWNER_S
    while writer_of(folder) and time.monotonic() < end:
        time.sleep(0.05)
    with sole_writer(folder):
        if (folder / RUN_FILE).is_file():
            if read_record(folder).get("stop_reason") not in set(UNFINISHED) - {STOPPED}:  # nobody has looked
                return Result.load(folder)
            last = checkpoint.last(folder)
            if last is not None and last.refusal:  # a component that cannot save its state: from the start again
                shutil.rmtree(folder / checkpoint.LAYERS_FOLDER)
        notes = origin_of(scenario, compare=False)
        Result.begin(folder, scenario.text, notes)
        return print_part(scenario, folder=folder, notes=notes)


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
