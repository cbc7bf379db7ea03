"""Print the part of a scenario, and its comparison runs, into a run folder."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import xarray as xr
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn
from rich.table import Column

from inkloop import report
from inkloop.errors import ResultError
from inkloop.events import Event, Manipulator
from inkloop.interrupt import deferred
from inkloop.master import Master
from inkloop.pacing import Pacing, sentence
from inkloop.recorder import LayerRow, Recorder
from inkloop.result import Result
from inkloop.scenario import Scenario

INTERRUPTED = 130  # exit code of a command that Ctrl-C ended


def run(scenario: Scenario, out: Path | None, console: Console, *, compare: bool = True) -> int:
    """Print, compare, save and show; returns the exit code of the command. An interrupted run keeps its layers."""
    folder = new_run_folder(out, Path(scenario.source).stem)
    with deferred() as interrupted, _progress(console) as progress:
        for place, variant in _runs(scenario, folder, compare):
            result = print_part(variant, progress)
            result.save(place)
            if "real_time" in result.run:
                progress.console.print(f"{result.run['label']}: {sentence(result.run['real_time'])}", highlight=False)
            stopped = interrupted() or result.stop_reason == "interrupted"
            if stopped:
                break
    console.print(report.write(folder))
    reason = "interrupted" if stopped else result.stop_reason
    console.print(f"{reason}: table, pictures and result.nc are in {folder}/", highlight=False)
    return INTERRUPTED if stopped else 0


def print_part(scenario: Scenario, progress: Progress | None = None) -> Result:
    """One print in memory, from the start surface to the end of the run. Raises ScenarioError, ComponentError."""
    job, limits = scenario.job(), scenario.tables.run
    components, connections = scenario.build()
    nominal = max(1, round(float(job.target_height.max()) / job.inks[0].layer_height))
    bar = _LayerBar(progress, scenario.tables.label, nominal) if progress else None
    recorder = Recorder(job, components, bar)
    events = scenario.events(components)
    pacing = Pacing(limits.real_time_factor) if limits.real_time_factor else None
    master = Master(
        components,
        connections,
        step_ns=round(limits.step_s * 1e9),
        algorithm=limits.algorithm,
        observers=[recorder],
        events=events,
        pacing=pacing,
    )
    time_max_ns = None if limits.time_max_s is None else round(limits.time_max_s * 1e9)
    stop_reason = master.run(layers_max=limits.layers_max, time_max_ns=time_max_ns)
    return Result.of(
        _marked(recorder.dataset(), events, Manipulator(events, components), round(limits.step_s * 1e9)),
        title=scenario.tables.title,
        label=scenario.tables.label,
        scenario_text=scenario.text,
        seed=scenario.tables.seed,
        stop_reason=stop_reason,
        wall_s=master.wall_s,
        components=components,
        notes=({"events": [str(event) for event in events]} if events else {})
        | ({"real_time": pacing.statistics} if pacing else {}),
    )


def _marked(dataset: xr.Dataset, events: Sequence[Event], manipulator: Manipulator, step_ns: int) -> xr.Dataset:
    """A dataset with `modified` by layer: an event was in effect in the step that completed it. Events in words."""
    if not events:
        return dataset
    ends_ns = np.nan_to_num(dataset["time"].values * 1e9).round().astype(np.int64)
    modified = [manipulator.in_effect(max(0, int(end_ns) - step_ns), layer) for layer, end_ns in enumerate(ends_ns)]
    attributes = {"units": "1", "long_name": "layers in which an event was in effect"}
    marked = dataset.assign(modified=xr.Variable(("layer",), np.array(modified), attributes))
    return marked.assign_attrs(events="\n".join(map(str, events)))


def new_run_folder(out: Path | None, name: str) -> Path:
    """The folder to write to: `out`, which must be new or empty, or the first free of runs/NAME, runs/NAME-2, ..."""
    if out is not None:
        if out.exists() and (not out.is_dir() or any(out.iterdir())):
            raise ResultError(f"{out}: is there already and not empty; name another --out, nothing is overwritten")
        return out
    base = Path("runs") / name
    candidates = (base if n == 1 else base.with_name(f"{name}-{n}") for n in range(1, 1_000_000))
    return next(candidate for candidate in candidates if not candidate.exists())


class _LayerBar:
    """Shows each finished layer: its number, the errors over the part, and what the plan for it took."""

    def __init__(self, progress: Progress, label: str, nominal_layers: int) -> None:
        self._progress = progress
        self._task: TaskID = progress.add_task(label, total=nominal_layers, figures="")

    def __call__(self, row: LayerRow) -> None:
        figures = f"layer {row.layer:3d}  mean error {row.mean_error * 1e6:7.2f} um  std {row.std * 1e6:5.2f} um"
        if "solve_time" in row.scalars:
            figures += f"  solve {row.scalars['solve_time'] * 1e3:5.1f} ms"
        total = max(row.layer, int(self._progress.tasks[self._task].total or 0))
        self._progress.update(self._task, completed=row.layer, total=total, figures=figures)


def _progress(console: Console) -> Progress:
    name = TextColumn("{task.description}", table_column=Column(no_wrap=True, min_width=12))
    figures = TextColumn("{task.fields[figures]}", table_column=Column(no_wrap=True, min_width=66))
    return Progress(name, BarColumn(16), figures, console=console)


def _runs(scenario: Scenario, folder: Path, compare: bool) -> Iterator[tuple[Path, Scenario]]:
    yield folder, scenario
    for name in scenario.tables.compare if compare else ():
        yield folder / report.COMPARE_FOLDER / _slug(name), scenario.variant(name)


def _slug(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")
