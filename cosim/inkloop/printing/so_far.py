"""Read the results in a run folder, ended or not, without taking part in the run.

The layers of a run that has not ended are read from its checkpoints, as `inkloop resume` reads them, but no component
is built: no bus is opened, no FMU started, and nothing is written.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from inkloop.contract import HEIGHT
from inkloop.errors import ResultError
from inkloop.files import reason_of
from inkloop.printing.on_devices import LOG_FILE
from inkloop.printing.run import scenario_of_run
from inkloop.report.page.live import Feed
from inkloop.report.run_report import load_runs
from inkloop.results import array_file
from inkloop.results.checkpoint import layer_files
from inkloop.results.lock import writer_of
from inkloop.results.recorder import Recorder
from inkloop.results.result import COMPARE_FOLDER, RESULT_FILE, RUN_FILE, UNFINISHED, Result, read_record

Stamp: TypeAlias = tuple[int, int, int]
"""State of a file: its inode, its length, and the time of its last change."""


def feed_of(folder: Path) -> Feed:
    """The content of a run folder for the live page. Raises ResultError, ScenarioError."""
    with scenario_of_run(folder) as scenario:
        layers = scenario.footprint.layers
    return Feed(RunFolder(folder), partial(state_of, folder), folder / LOG_FILE, layers)


def state_of(folder: Path) -> str:
    """A sentence on a run that has not ended, empty if it has. Raises ResultError."""
    record = read_record(folder)
    if record.get("stop_reason") not in UNFINISHED:
        return ""
    if owner := writer_of(folder):
        return f"Being printed by {owner}."
    return f"No process of this machine prints it; `inkloop resume {folder}` continues it."


class RunFolder:
    """The run in `folder` and its comparison runs; a run whose files have not changed since is not read again."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._known: dict[Path, tuple[dict[Path, Stamp], Result | None]] = {}

    def stamps(self) -> dict[Path, Stamp]:
        """State of the files that `runs` reads; equal if nothing has changed."""
        return {path: stamp for place in self._places() for path, stamp in _stamps(place).items()}

    def runs(self) -> dict[str, Result]:
        """The run first, then its comparison runs, by name. Raises ResultError, ScenarioError."""
        found = {place: result for place in self._places() if (result := self._result(place))}
        if self._folder not in found:
            read_record(self._folder)  # raises the error of a folder that is none
            raise ResultError(f"{self._folder}: no layer is finished yet; try again later")
        return load_runs(self._folder, found)

    def _places(self) -> list[Path]:
        return [self._folder, *sorted(path.parent for path in (self._folder / COMPARE_FOLDER).glob(f"*/{RUN_FILE}"))]

    def _result(self, place: Path) -> Result | None:
        """The run of one folder, None before its first layer."""
        stamps = _stamps(place)
        if place not in self._known or self._known[place][0] != stamps:
            is_running = read_record(place).get("stop_reason") == "running"
            self._known[place] = stamps, _so_far(place) if is_running else Result.load(place)
        return self._known[place][1]


def _so_far(place: Path) -> Result | None:
    """The layers of a run that has not ended, None before the first; their maps stay on disk until they are used."""
    with scenario_of_run(place) as scenario:
        recorder, taken = Recorder(scenario.job(), scenario.ports), list[Mapping[str, Any]]()
    for path in layer_files(place):
        try:
            with array_file.opened(path) as rows:
                recorder.put_rows(rows)
                taken.append({name: array_file.StoredArray(path, name) for name in rows})
        except FileNotFoundError:
            continue  # the run ends at this moment; its result follows
        except array_file.UNREADABLE as error:
            reason = reason_of(error) if isinstance(error, OSError) else str(error)
            raise ResultError(f"{path}: cannot be read: {reason}") from error
    dataset, tables = recorder.maps(taken).laid_over(recorder.table()), scenario.tables
    if HEIGHT not in dataset:
        return None
    return Result.of(
        dataset,
        title=tables.title,
        label=tables.label,
        scenario_text=scenario.text,
        seed=tables.seed,
        stop_reason="running",
        wall_s={"total": math.nan},
        components={},
    )


def _stamps(place: Path) -> dict[Path, Stamp]:
    """State of the files of one run."""
    found = {}
    for path in (place / RUN_FILE, place / RESULT_FILE, *layer_files(place)):
        try:
            state = path.stat()
        except FileNotFoundError:
            continue
        found[path] = (state.st_ino, state.st_size, state.st_mtime_ns)
    return found
