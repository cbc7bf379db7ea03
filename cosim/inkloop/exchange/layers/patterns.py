"""Patterns to be jetted: those of a run, or the plan of an open loop for a scenario."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from inkloop.component import Ink, Status
from inkloop.components import catalog
from inkloop.contract import (
    DROP_LEVEL,
    LAYER_UNKNOWN,
    LAYERS_PRINTED,
    LAYERS_SCANNED,
    PATTERN,
    SIGNALS,
    STATUS,
    VALID,
    PassOrder,
    pass_colours,
)
from inkloop.errors import ResultError
from inkloop.files import toml_tables
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop.tables.job import inks_of
from inkloop.tables.schema import Process, ScenarioFile

OPEN_LOOP = "OpenLoop"


@dataclass(frozen=True, eq=False)
class Patterns:
    """Patterns of layers 1, 2, ... pattern: (layers, nx, ny), 0 none, 1 A, 2 B; drop_level: the same shape, None for 1.

    origin: their source, for a person; pitch [m]; unknown_layers: aborted layers of a run, of which an unknown part was
    jetted.
    """

    origin: str
    scenario_text: str
    pitch: float
    inks: tuple[Ink, ...]
    process: Process
    pattern: NDArray[np.integer]
    drop_level: NDArray[np.integer] | None = None
    unknown_layers: tuple[int, ...] = ()

    @property
    def levels(self) -> int:
        """Largest number of drops in a droplet of any layer."""
        return 1 if self.drop_level is None else max(1, int(self.drop_level[self.pattern > 0].max(initial=1)))

    def colours(self, layer: int) -> tuple[int, ...]:
        """Colours of the passes in the order in which a layer jets them; none in one pass."""
        process = self.process
        order = PassOrder[process.pass_order.upper()].value
        return pass_colours(process.passes, order, process.pass_rotation, layer)


def of_run(result: Result, source: str) -> Patterns:
    """The patterns as they were commanded. Raises ResultError where the run has none."""
    run = result.dataset
    if PATTERN not in run or run.sizes["layer"] < 2:
        held = ", ".join(map(str, run.data_vars))
        raise ResultError(f"{source}: holds no pattern of any layer; it has {run.sizes['layer'] - 1} layers of {held}")
    try:
        tables = ScenarioFile.model_validate(toml_tables(result.scenario_text))
    except (ValidationError, ValueError) as error:
        raise ResultError(f"{source}: its scenario is no longer valid; run it again ({_first_line(error)})") from error
    return Patterns(
        f"run: {run.attrs['title']}, {run.attrs['label']}, {result.stop_reason}",
        result.scenario_text,
        float(run.attrs["pitch"]),
        inks_of(tables.ink, 2 if "ink" in run else 1),
        tables.process,
        run[PATTERN].values[1:],
        np.maximum(run[DROP_LEVEL].values[1:], 1) if DROP_LEVEL in run else None,
        tuple(np.flatnonzero(run[LAYER_UNKNOWN].values).tolist()) if LAYER_UNKNOWN in run else (),
    )


def of_open_loop(scenario: Scenario) -> Patterns:
    """The patterns of the scenario's open-loop run, without a plant: that controller uses no scan.

    The controller is that of the scenario, or of the first comparison run that has one; otherwise it has no options.
    """
    origin, job, options = _open_loop(scenario)
    controller = catalog.make(OPEN_LOOP, job, options)
    shape = (job.nx, job.ny)
    inputs: dict[str, Any] = {port.name: SIGNALS[port.name].port(shape).start_value() for port in controller.inputs}
    inputs |= {LAYERS_PRINTED: np.asarray(0, np.int32), LAYERS_SCANNED: np.asarray(0, np.int32)}
    inputs[VALID] = np.ones(shape, np.bool_)  # a scan of flat ground
    controller.initialize(0, inputs)
    patterns: list[NDArray[np.integer]] = []
    try:
        while len(patterns) < scenario.tables.run.layers_max:
            outputs = controller.do_step(len(patterns), 1, inputs)
            if outputs[STATUS] == Status.DONE:
                break
            patterns.append(outputs[PATTERN].astype(np.int8))
            inputs |= dict.fromkeys((LAYERS_PRINTED, LAYERS_SCANNED), np.asarray(len(patterns), np.int32))
    finally:
        controller.terminate()
    planned = np.array(patterns).reshape(len(patterns), *shape)
    return Patterns(origin, scenario.text, job.pitch, job.inks, scenario.tables.process, planned)


def _open_loop(scenario: Scenario) -> tuple[str, Any, dict[str, Any]]:
    """Origin, job and options of the open loop."""
    title = scenario.tables.title
    runs = [scenario, *(scenario.variant(name) for name in scenario.tables.compare)]
    for run in runs:
        for name, table in run.tables.components.items():
            if table.kind == OPEN_LOOP:
                return f"planned: {title}, {run.tables.label}", run.job(name), run.options(name)
    return f"planned: {title}, open loop", scenario.job(), {}


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
