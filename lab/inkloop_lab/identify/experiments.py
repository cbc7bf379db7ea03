"""Experiments on a plant: patterns that identify an ink, printed in a loop of the plant and its profiler, and recorded.

The plant is the printer of a scenario, with that scenario's pitch, inks, process and profiler; or any kind of the
catalog or FMU file in a loop made for it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tomlkit
from pydantic import Field

from inkloop.component import Job, Status, Values
from inkloop.components import catalog
from inkloop.contract import LAYER_COMMAND, LAYERS_PRINTED, LAYERS_SCANNED, PATTERN, STATUS, contract_ports, has_port
from inkloop.errors import ScenarioError
from inkloop.fmu import describe
from inkloop.printing.print import Print
from inkloop.scenario.file import Scenario
from inkloop_lab.identify import designs
from inkloop_lab.identify.print_record import PrintRecord, record_of

KIND = "inkloop_lab.identify.experiments:Experiment"
MARGIN = 4  # empty cells around the layers: the outer ones show the noise of the scans
_DROPPED = ("support", "events", "compare", "literature", "connections")


class Experiment:
    """Takes the controller's place and prints a design, layer by layer, without regard to the scans. See `designs`."""

    def __init__(
        self,
        job: Job,
        *,
        design: Literal["droplets", "layers"],
        layers: Annotated[int, Field(ge=1)] = 6,
        design_seed: Annotated[int, Field(ge=0)] = 0,
    ) -> None:
        self._patterns = (
            designs.droplets(job.nx, job.ny, design_seed)
            if design == "droplets"
            else designs.layers(job.nx, job.ny, layers, design_seed, MARGIN)
        )
        self._command = 0
        shape = (job.nx, job.ny)
        self.inputs = contract_ports(shape, LAYERS_PRINTED, LAYERS_SCANNED)
        self.outputs = contract_ports(shape, PATTERN, LAYER_COMMAND, STATUS)

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        """Nothing is commanded yet."""
        return self._outputs(Status.IDLE)

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        """The next layer once the last one is printed and scanned."""
        printed, scanned = int(inputs[LAYERS_PRINTED]), int(inputs[LAYERS_SCANNED])
        is_due = printed == scanned == self._command
        if is_due and self._command == len(self._patterns):
            return self._outputs(Status.DONE)
        self._command += int(is_due)
        return self._outputs(Status.IDLE)

    def terminate(self) -> None:
        """Nothing to release."""

    def _outputs(self, status: Status) -> Values:
        return {
            PATTERN: self._patterns[max(0, self._command - 1)].copy(),
            LAYER_COMMAND: np.asarray(self._command, np.int32),
            STATUS: np.asarray(int(status), np.int32),
        }


@dataclass(frozen=True)
class Plan:
    """samples: of every motif of droplets, 0 for none; layers: of many droplets on side x side cells; seed: of places
    and random patterns.
    """

    samples: int = 75
    layers: int = 6
    side: int = 32
    seed: int = 0


def perform(
    scenario: Scenario, plan: Plan, folder: Path | None = None, on_layer: Callable[[int, int], None] | None = None
) -> list[PrintRecord]:
    """Print the designs of a plan on the plant of a scenario; one record each.

    folder: keeps the runs in it; on_layer: gets layers printed and all layers. Raises ScenarioError, ComponentError.
    """
    chosen = {"droplets": designs.droplets_side(plan.samples)} if plan.samples else {}
    chosen |= {"layers": plan.side + 2 * MARGIN} if plan.layers else {}
    total = sum({"droplets": 2, "layers": plan.layers}[design] for design in chosen)
    records, done = [], 0
    for design, side in chosen.items():
        loop = experiment_of(scenario, design, side, plan)

        def report(row: Any, before: int = done) -> None:
            if on_layer:
                on_layer(before + row.layer, total)

        result = Print(loop, on_layer=report).run()
        if result.stop_reason == "interrupted":
            raise KeyboardInterrupt
        if folder:
            result.save(folder / design)
        records.append(record_of(result, design))
        done += len(records[-1].pattern)
    return records


def experiment_of(scenario: Scenario, design: str, side: int, plan: Plan) -> Scenario:
    """The scenario with another controller and grid, printing a design. Raises ScenarioError."""
    document = tomlkit.parse(scenario.text)
    for name in _DROPPED:
        document.pop(name, None)
    for name in _controllers(scenario):
        options: dict[str, Any] = {"kind": KIND, "design": design, "design_seed": plan.seed}
        document["components"][name] = options | ({"layers": plan.layers} if design == "layers" else {})
    grid = scenario.tables.grid
    document["grid"] = {"nx": side, "ny": side, "pitch_um": grid.pitch_um}
    width = (side - 2 * MARGIN) * grid.pitch_um
    document["part"] = {"shape": "cuboid", "size_x_um": width, "size_y_um": width, "height_um": 1000.0}
    document["title"] = f"{scenario.tables.title}: {design}"
    return Scenario.of_text(tomlkit.dumps(document), scenario.source)


def plant_scenario(plant: str, noise_um: float, overrides: Mapping[str, Any] | None = None) -> Scenario:
    """A loop around a kind of the catalog or an FMU file. Raises ScenarioError, FmuError."""
    components: dict[str, Mapping[str, Any]] = {
        "controller": {"kind": KIND, "design": "layers"},
        "printer": _printer(plant),
        "profiler": {"kind": "ProfileSensor", "noise_std_um": noise_um, "scan_duration_s": 0.0},
    }
    part = {"shape": "cuboid", "size_x_um": 1.0, "size_y_um": 1.0, "height_um": 1000.0}
    tables = {"title": Path(plant).stem, "grid": {"nx": 9, "ny": 9}, "part": part, "components": components}
    return Scenario.of_text(tomlkit.dumps(tables), plant, overrides)


def _printer(plant: str) -> dict[str, Any]:
    """The table of a plant; an FMU without the handshake of the layer contract is given one."""
    if not plant.endswith(".fmu"):
        return {"kind": plant}
    is_whole = LAYER_COMMAND in describe(plant).variables
    return {"kind": "Fmu" if is_whole else catalog.PLAIN_PLANT, "file": str(Path(plant).resolve())}


def _controllers(scenario: Scenario) -> list[str]:
    """Names of the components that command layers. Raises ScenarioError if there is none."""
    found = [name for name, part in scenario.ports.items() if has_port(part.outputs, LAYER_COMMAND)]
    if not found:
        raise ScenarioError(scenario.source, ["no component commands layers; experiments take the controller's place"])
    return found
