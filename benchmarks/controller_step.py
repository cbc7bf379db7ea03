"""Duration of a step of `LayerController.fmu` that answers a scan, with and without a time limit."""

from __future__ import annotations

from time import perf_counter
from typing import Any

import numpy as np
from rich.table import Table

from benchmarks.timing import scaled
from inkloop.component import FloatMap, Job
from inkloop.components import catalog
from inkloop.units import NS_PER_S
from inkloop_controller.model.layer_model import LayerModel

SIDES = (35, 100, 500)
TARGET_M = 100e-6
SURFACES = {"40 um to go": 52e-6, "nearly done": 92e-6}
SHARES = (1.0, 0.5, 0.25)  # of the time that the plan takes by itself


def measure() -> Table:
    """Wall times of whole steps, and the objective of a plan that had less time."""
    table = Table(title="a step of LayerController.fmu that answers a scan, horizon 3, one thread")
    for heading in ("grid", "surface", "no limit", "limit", "step", "limit", "step", "objective"):
        table.add_column(heading, justify="right")
    for side in SIDES:
        for name, mean in SURFACES.items():
            table.add_row(f"{side} x {side}", name, *_row(side, mean))
    return table


def _row(side: int, mean: float) -> list[str]:
    job = _job(side)
    rng = np.random.default_rng(1)
    surface = np.where(job.mask, mean + rng.uniform(-4e-6, 4e-6, job.mask.shape), 0.0)
    free, best = _step(job, surface, 0.0)
    cells = [scaled(free)]
    value = best
    for share in SHARES[1:]:
        taken, value = _step(job, surface, share * free)
        cells += [scaled(share * free), scaled(taken)]
    return [*cells, f"{value / best - 1.0:+.1%}"]


def _step(job: Job, surface: FloatMap, limit: float) -> tuple[float, float]:
    """Seconds of the step that answers the scan of layer 1, and the objective of its plan [m]."""
    controller = catalog.make("LayerController", job, {"time_limit_s": limit, "horizon": 3, "layer_worth": 0.0})
    try:
        controller.initialize(0, _scan(surface, 0))
        first = controller.do_step(0, NS_PER_S, _scan(surface, 0))
        scan = _scan(LayerModel.of(job).layer(surface, first["pattern"]), 1)
        begin = perf_counter()
        outputs = controller.do_step(NS_PER_S, NS_PER_S, scan)
        return perf_counter() - begin, float(outputs["objective"])
    finally:
        controller.terminate()


def _scan(surface: FloatMap, layer: int) -> dict[str, Any]:
    number = np.int32(layer)
    counts = {"layers_scanned": number, "layers_printed": number, "layer_unknown": np.bool_(False)}
    return {"measured_height": surface, "valid": np.ones(surface.shape, np.bool_), **counts}


def _job(side: int) -> Job:
    mask = np.zeros((side, side), np.bool_)
    mask[2:-2, 2:-2] = True
    return Job(side, side, 263.256e-6, np.where(mask, TARGET_M, 0.0), mask)
