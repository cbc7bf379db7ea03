"""One print of a scenario: its loop, its record, and its layers on disk, from which it can resume."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from inkloop.component import Values, is_device
from inkloop.contract import MEASURED_HEIGHT
from inkloop.course.events import Event, Manipulator
from inkloop.course.layer_course import LayerCourse
from inkloop.errors import ComponentError, ResultError
from inkloop.fmu.bus import BusLinks
from inkloop.master.master import Master
from inkloop.master.pacing import Pacing
from inkloop.master.roles import StopReason
from inkloop.results.attributes import variable
from inkloop.results.checkpoint import Checkpoint, Checkpoints, remove_layers
from inkloop.results.recorder import LayerRow, Recorder
from inkloop.results.result import READ_AT_ONCE, RESULT_FILE, STOPPED, UNFINISHED, Result, saving
from inkloop.results.surface import with_parameters
from inkloop.scenario.file import Scenario
from inkloop.units import NS_PER_S, UM_PER_M

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["Print"]


class Print:
    """A print in memory, or with its layers in `folder`: then it resumes after the layers that exist.

    on_layer: called for every printed layer; notes: further entries of run.json. Raises ScenarioError.
    """

    def __init__(
        self,
        scenario: Scenario,
        folder: Path | None = None,
        *,
        on_layer: Callable[[LayerRow], None] | None = None,
        notes: Mapping[str, Any] | None = None,
    ) -> None:
        limits = scenario.tables.run
        self._scenario, self._folder, self._notes = scenario, folder, dict(notes or {})
        self._components = scenario.build(folder)
        self._events = scenario.events
        self._recorder = Recorder(scenario.job(), self._components, on_layer)
        self._checkpoints = Checkpoints(folder, self._components, self._recorder) if folder else None
        self._pacing = Pacing(limits.real_time_factor) if limits.real_time_factor else None
        self._step_ns = round(limits.step_s * NS_PER_S)
        buses = [BusLinks(self._components, scenario.buses)] if scenario.buses else []  # before a state is saved
        self._master = Master(
            self._components,
            scenario.connections,
            step_ns=self._step_ns,
            algorithm=limits.algorithm,
            observers=[*buses, self._recorder, *([self._checkpoints] if self._checkpoints else [])],
            course=LayerCourse(
                self._components,
                layers_max=limits.layers_max,
                events=self._events,
                fed={connection.target for connection in scenario.connections},
            ),
            pacing=self._pacing,
            on_end=self._ended,
        )

    def run(self) -> Result:
        """Print to the end of the run, and save the result if there is a folder, also when a component fails.

        Raises ComponentError, and ResultError if the folder cannot be resumed or written.
        """
        limits = self._scenario.tables.run
        time_max_ns = None if limits.time_max_s is None else round(limits.time_max_s * NS_PER_S)
        checkpoint = self._load()
        try:
            reason = self._master.run(time_max_ns=time_max_ns, resume=checkpoint)
        except ComponentError as error:
            if self._folder and self._checkpoints and self._checkpoints.layer is not None:
                self._result("failed")
                advice = self._advice(self._folder, self._checkpoints, error)
                raise ComponentError(f"{error}\n{advice}") from error
            raise
        result = self._result(reason)
        if self._folder and reason not in UNFINISHED:
            remove_layers(self._folder)
        return result

    def _ended(self, reason: StopReason, time_ns: int, outputs: Mapping[str, Values]) -> None:
        """Keep the state of a print that can go on from here."""
        if self._checkpoints and reason == "interrupted":
            self._checkpoints.interrupted(time_ns, outputs)
        elif self._checkpoints and reason == STOPPED:
            self._checkpoints.stopped(time_ns, outputs)

    def _load(self) -> Checkpoint | None:
        """The checkpoint to resume from, if any. Raises ResultError if it cannot resume, after saving the result."""
        if not self._folder or not self._checkpoints:
            return None
        try:
            checkpoint = self._checkpoints.load()
            if checkpoint and checkpoint.refusal:
                self._result("interrupted")
                raise ResultError(
                    f"{self._folder}: cannot be resumed: {checkpoint.refusal}; its layers 0 to {checkpoint.layer} are "
                    f"in {RESULT_FILE}; run the scenario again for the others"
                )
        except ResultError:
            for component in self._components.values():
                component.terminate()
            raise
        if checkpoint:
            self._notes["resumed_after_layer"] = checkpoint.layer
        return checkpoint

    def _result(self, stop_reason: str) -> Result:
        """The result so far, saved if there is a folder; the maps of a large one stay there until they are used."""
        tables, notes = self._scenario.tables, dict(self._notes)
        if self._events:
            notes["events"] = [str(event) for event in self._events]
        if self._pacing:
            notes["real_time"] = self._pacing.statistics
        if self._checkpoints and self._checkpoints.refusal:
            notes["not_resumable"] = self._checkpoints.refusal
        manipulator = Manipulator(self._events, self._components)
        dataset, maps = self._recorder.table(), (self._checkpoints or self._recorder).maps()
        in_memory = not self._folder or maps.nbytes <= READ_AT_ONCE
        if in_memory:
            with saving(self._folder) if self._folder else nullcontext():
                dataset = maps.added_to(dataset)
            dataset = self._evaluated(dataset)
        result = Result.of(
            _marked(dataset, self._events, manipulator, self._step_ns),
            title=tables.title,
            label=tables.label,
            scenario_text=self._scenario.text,
            seed=tables.seed,
            stop_reason=stop_reason,
            wall_s=self._master.wall_s,
            components=self._components,
            notes=notes,
        )
        if not self._folder:
            return result
        result.save(self._folder, None if in_memory else maps)
        return result if in_memory else self._read_back(self._folder)

    def _advice(self, folder: Path, checkpoints: Checkpoints, error: ComponentError) -> str:
        """Advice after a failed print: which layers are kept, and how to resume it unless the error says what to do."""
        kept = f"layers 0 to {checkpoints.layer} are in {folder}"
        if checkpoints.refusal:
            return f"{kept}; the run cannot be resumed: {checkpoints.refusal}"
        has_device = any(is_device(component) for component in self._components.values())
        bench = f" (`inkloop bench` takes {folder} as SCENARIO)" if has_device else ""
        if error.remedy_is_said:
            return f"{kept}{bench}"
        return f"{kept}; fix the cause{bench}, then continue with `inkloop resume {folder}`"

    def _read_back(self, folder: Path) -> Result:
        """The result in `folder`, with the parameters of its surface; its maps are read when they are used."""
        if self._scenario.tables.metrology:
            result = Result.load(folder)
            Result(self._evaluated(result.dataset), result.run).save(folder)
        return Result.load(folder)

    def _evaluated(self, run: xr.Dataset) -> xr.Dataset:
        """The run with the parameters that the scenario's [metrology] asks for."""
        asked = self._scenario.tables.metrology
        return with_parameters(run, asked.evaluation) if asked else run


def _marked(dataset: xr.Dataset, events: Sequence[Event], manipulator: Manipulator, step_ns: int) -> xr.Dataset:
    """A dataset with `modified` by layer: an event was in effect in the step that completed it. Events as text."""
    if not events:
        return dataset
    ends_ns = np.nan_to_num(dataset["time"].values * NS_PER_S).round().astype(np.int64)
    modified = [manipulator.in_effect(max(0, int(end_ns) - step_ns), layer) for layer, end_ns in enumerate(ends_ns)]
    marked = dataset.assign(modified=variable("modified", ("layer",), np.array(modified), "1"))
    return marked.assign_attrs(events="\n".join(map(str, events)))


KINDS = ("LayerMpc", "LayerController")
ALPHA = 0.8  # for both, if none is given
HORIZON_MAX = 5


def check_first_layer(scenario: Scenario, result: Result) -> None:
    """Raises ComponentError where nothing was printed although half a layer lacks, and alpha or horizon can be raised.

    A part that is lower, or that the first scan shows already, needs no layer.
    """
    if result.stop_reason != "done" or result.dataset.sizes["layer"] > 1 or MEASURED_HEIGHT not in result.dataset:
        return
    for name, table in scenario.tables.components.items():
        larger = " or ".join(_larger(table.options)) if table.kind in KINDS else ""
        if not larger:
            continue
        job, scan = scenario.job(name), result.dataset[MEASURED_HEIGHT].values[0]
        missing = float(np.nanmean((job.target_height - scan)[job.mask]))
        if missing > 0.5 * max(ink.layer_height for ink in job.inks):
            raise ComponentError(
                f"{name}: nothing was printed with {_words(table.options)}, although {missing * UM_PER_M:.3g} µm lack "
                "on average: a first layer costs more in standard deviation, of weight 1 - alpha, than it gains in "
                f"mean error, of weight alpha; choose {larger}"
            )


def _words(options: Mapping[str, Any]) -> str:
    shown = {"alpha": ALPHA, **options}
    return ", ".join(f"{name} = {shown[name]}" for name in ("alpha", "horizon", "finish") if name in shown)


def _larger(options: Mapping[str, Any]) -> Iterator[str]:
    """A larger alpha, a longer horizon, as far as there are any; a schedule of alpha may always be larger."""
    if options.get("alpha", ALPHA) != 1.0:
        yield "a larger alpha"
    if (options.get("horizon") or HORIZON_MAX) < HORIZON_MAX:
        yield "a longer horizon"
