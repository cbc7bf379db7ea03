"""Hardware against model, layer by layer: scanned surface of a device minus the model's.

The model is the shadow of the run where it had one, else `LayerDeposition` with the inks and passes of the scenario and
none of its variations, begun on the scan of layer 0 and fed with the commanded patterns.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import tomlkit
import xarray as xr
from numpy.typing import NDArray
from rich.table import Table

from inkloop.component import Component, FloatMap, Job
from inkloop.components import catalog, devices
from inkloop.components.followed_plant import FollowedPlant
from inkloop.components.shadow import ScannedLayer, start_surface
from inkloop.contract import LAYER_COMMAND, MEASURED_HEIGHT, PATTERN, VALID
from inkloop.report.terminal import number_table
from inkloop.results.result import Result
from inkloop.tables.job import Target, job_of
from inkloop.tables.schema import ScenarioFile
from inkloop.units import NS_PER_S, UM_PER_M

MODEL = "LayerDeposition"
DEVICE = "hardware."
SIGN = "hardware higher +, lower -"
_STEP_NS = NS_PER_S  # a step of the plant is a layer of any length


@dataclass(frozen=True)
class LayerDifference:
    """Hardware minus model over the cells of the part that were seen [m]; growth: rms of the growth in the layer.

    worst: the largest in amount, at `cell` (i, j).
    """

    layer: int
    mean: float
    rms: float
    growth: float
    worst: float
    cell: tuple[int, int]


@dataclass(frozen=True, eq=False)
class ModelDifference:
    """model: its name; maps: (layer, x, y) hardware minus model [m], NaN where not seen; a row for each scan."""

    model: str
    maps: NDArray[np.float64]
    rows: tuple[LayerDifference, ...]

    @property
    def farthest(self) -> LayerDifference:
        """The layer with the largest rms."""
        return max(self.rows, key=lambda row: row.rms)

    def sentence(self) -> str:
        """A sentence on the layer with the largest difference."""
        row = self.farthest
        return (
            f"hardware minus {self.model} ({SIGN}): farthest in layer {row.layer}, mean {row.mean * UM_PER_M:+.2f}, "
            f"rms {row.rms * UM_PER_M:.2f} µm, worst cell {row.cell} {row.worst * UM_PER_M:+.2f} µm"
        )

    def table(self) -> Table:
        """A row for each layer [um]."""
        caption = "over the part's cells that were seen, in µm; growth: rms of what the layer added to the difference"
        headings = ("mean", "rms", "growth", "worst", "at cell")
        table = number_table("layer", *headings, title=f"Hardware minus {self.model} ({SIGN})", caption=caption)
        for row in self.rows:
            growth = "-" if np.isnan(row.growth) else f"{row.growth * UM_PER_M:.2f}"
            values = (
                f"{round(row.mean * UM_PER_M, 2) + 0.0:+.2f}",
                f"{row.rms * UM_PER_M:.2f}",
                growth,
                f"{row.worst * UM_PER_M:+.2f}",
            )
            table.add_row(str(row.layer), *values, f"{row.cell[0]}, {row.cell[1]}")
        return table


def model_difference(result: Result) -> ModelDifference | None:
    """Of a run whose printer is a device and that was scanned; None for any other. Raises FmuError."""
    run = result.dataset
    raw = tomlkit.parse(result.scenario_text).unwrap()
    kinds = {name: str(table.get("kind")) for name, table in raw.get("components", {}).items()}
    printers = [name for name, kind in kinds.items() if kind.startswith(DEVICE) and kind != "hardware.profiler"]
    if not printers or not {MEASURED_HEIGHT, VALID, PATTERN} <= set(run):
        return None
    if "shadow_height" in run:
        name, surfaces = "the shadow", run.shadow_height.values
    else:
        tables = ScenarioFile.model_validate(raw)
        job = job_of(tables, _target(run), printers[0])
        table = tables.components[printers[0]]
        name = MODEL
        surfaces = followed(run, devices.job_with_overrides(job, table.options) if table.kind in devices.KINDS else job)
    seen = run.valid.values.astype(bool) & run.mask.values.astype(bool)
    maps = np.where(seen, run.measured_height.values - surfaces, np.nan)
    rows = tuple(_rows(run, surfaces))
    return ModelDifference(name, maps, rows) if rows else None


def _target(run: xr.Dataset) -> Target:
    """The target of a run; the model needs no regions of ink, since it gets patterns."""
    return Target(run.mask.values.astype(bool), run.target_height.values, inks=2 if "ink" in run else 1)


def followed(run: xr.Dataset, job: Job) -> FloatMap:
    """Surfaces (layer, x, y) [m] of the model, with the patterns of a run, from its first scan on."""

    def make(job: Job) -> Component:
        return catalog.make(MODEL, job, {})

    plant = FollowedPlant(job, make)
    try:
        plant.begin(0)
        plant.begin_on(start_surface(plant.start_surface, run.measured_height.values[0], run.valid.values[0]))
        surfaces = [plant.surfaces[0]]
        for layer in range(1, run.sizes["layer"]):
            command = {LAYER_COMMAND: np.asarray(layer, np.int32), PATTERN: run.pattern.values[layer]}
            plant.take_command(command)
            plant.follow(layer, _STEP_NS)
            surfaces.append(plant.surfaces[layer])
            plant.forget_before(layer)
    finally:
        plant.terminate()
    return np.array(surfaces)


def _rows(run: xr.Dataset, surfaces: FloatMap) -> Iterator[LayerDifference]:
    mask, before = run.mask.values.astype(bool), None
    for layer in range(run.sizes["layer"]):
        valid = run.valid.values[layer].astype(bool)
        scan = ScannedLayer(run.measured_height.values[layer], valid, surfaces[layer])
        seen = valid & mask
        if seen.any():
            error = scan.measured - scan.surface
            i, j = divmod(int(np.where(seen, np.abs(error), -1.0).argmax()), error.shape[1])
            divergence = scan.divergence(before, mask)
            mean, worst = float(error[seen].mean()), float(error[i, j])
            yield LayerDifference(layer, mean, divergence.surface, divergence.growth, worst, (i, j))
            before = scan
