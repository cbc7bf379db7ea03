"""One print of a study: what it is to print, and the record that is left of it.

`perform` runs in a process or on a machine of its own. It knows no other print, and what it returns is all that there
is of the print, but for its run folder where runs are kept.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.errors import ResultError, ScenarioError, message_of
from inkloop.files import reason_of
from inkloop.printing.run import origin_of, print_part
from inkloop.results import checkpoint
from inkloop.results.lock import sole_writer, writer_of
from inkloop.results.result import RUN_FILE, STOPPED, UNFINISHED, Result, read_record
from inkloop.scenario.file import Scenario
from inkloop.scenario.packaged import classes_from

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
