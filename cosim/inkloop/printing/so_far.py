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
from inkloop.printing.device_log import LOG_FILE
from inkloop.printing.run import scenario_file, scenario_of_run
from inkloop.report.page.feed import Feed
from inkloop.report.run_report import load_runs
from inkloop.results import array_file
from inkloop.results.checkpoint import layer_files
from inkloop.results.lock import writer_of
from inkloop.results.recorder import Recorder
from inkloop.results.result import COMPARE_FOLDER, RESULT_FILE, RUN_FILE, UNFINISHED, Result, read_record
from inkloop.scenario.class_path import classes_from
from inkloop.scenario.file import Scenario

Stamp: TypeAlias = tuple[int, int, int]
"""State of a file: its inode, its length, and the time of its last change."""


def feed_of(folder: Path) -> Feed:
    """The content of a run folder for the live page. Raises ResultError, ScenarioError."""
    with classes_from(scenario_file(folder).parent):
        scenario = scenario_of_run(folder)
    return Feed(RunFolder(folder), partial(state_of, folder), folder / LOG_FILE, scenario.footprint.layers)


def state_of(folder: Path) -> str:
    """A sentence on a run that has not ended, empty if it has. Raises ResultError."""
    record = read_record(folder)
    if record.get("stop_reason") not in UNFINISHED:
        return ""
    if owner := writer_of(folder):
        return f"Being printed by {owner}."
    return f"No process of this machine prints it; `inkloop resume {folder}` continues it."


class RunFolder:
    """The run in `folder` and its comparison runs; files that have not changed since are not read again."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._known: dict[Path, tuple[dict[Path, Stamp], Result]] = {}
        self._layers: dict[Path, _Layers] = {}

    def stamps(self) -> dict[Path, Stamp]:
        """State of the files that `runs` reads; equal if nothing has changed."""
        found: dict[Path, Stamp] = {}
        for place in self._places():
            found |= _stamps([place / RUN_FILE, place / RESULT_FILE, *layer_files(place)])
        return found

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
        stamps = _stamps([place / RUN_FILE, place / RESULT_FILE, *layer_files(place)])
        if place in self._known and self._known[place][0] == stamps:
            return self._known[place][1]
        record = read_record(place)
        if record.get("stop_reason") != "running":
            result: Result | None = Result.load(place)
            self._layers.pop(place, None)
        else:
            if place not in self._layers:
                self._layers[place] = _Layers(place, self._folder)
            result = self._layers[place].read()
        if result:
            self._known[place] = stamps, result
        return result


class _Layers:
    """The layers of one run that has not ended; their maps stay on disk until they are used."""

    def __init__(self, place: Path, main: Path) -> None:
        self._place = place
        with classes_from(scenario_file(main).parent):
            self._scenario: Scenario = scenario_of_run(place)
        self._recorder = self._new_recorder()
        self._rows: dict[Path, tuple[Stamp, Mapping[str, Any]]] = {}

    def read(self) -> Result | None:
        """The result of the layers on disk, None before the first surface is known."""
        stamps = _stamps(layer_files(self._place))
        if not stamps:
            return None
        if not self._rows.keys() <= stamps.keys():  # a resumed run has removed a layer to print it again
            self._recorder, self._rows = self._new_recorder(), {}
        for path, stamp in stamps.items():
            if path in self._rows and self._rows[path][0] == stamp:
                continue
            try:
                with array_file.opened(path) as rows:
                    self._recorder.put_rows(rows)
                    self._rows[path] = stamp, {name: array_file.StoredArray(path, name) for name in rows}
            except FileNotFoundError:
                continue  # the run ends at this moment; its result follows
            except array_file.UNREADABLE as error:
                reason = reason_of(error) if isinstance(error, OSError) else str(error)
                raise ResultError(f"{path}: cannot be read: {reason}") from error
        taken = [self._rows[path][1] for path in layer_files(self._place) if path in self._rows]
        dataset, tables = self._recorder.maps(taken).laid_over(self._recorder.table()), self._scenario.tables
        if HEIGHT not in dataset:
            return None
        return Result.of(
            dataset,
            title=tables.title,
            label=tables.label,
            scenario_text=self._scenario.text,
            seed=tables.seed,
            stop_reason="running",
            wall_s={"total": math.nan},
            components={},
        )

    def _new_recorder(self) -> Recorder:
        return Recorder(self._scenario.job(), self._scenario.ports)


def _stamps(paths: list[Path]) -> dict[Path, Stamp]:
    found = {}
    for path in paths:
        try:
            state = path.stat()
        except FileNotFoundError:
            continue
        found[path] = (state.st_ino, state.st_size, state.st_mtime_ns)
    return found
