"""Precision of a time limit: from the scan to the pattern, estimate included, with more work than time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from rich.progress import track
from rich.table import Table

from benchmarks.timing import scaled, table_of, timed
from inkloop.component import FloatMap, Job
from inkloop.units import NS_PER_S
from inkloop_controller.baseline_planners import nominal_layer_height
from inkloop_controller.core import bindings
from inkloop_controller.estimation.height_estimator import HeightEstimator
from inkloop_controller.layer_controller import LayerController
from inkloop_controller.planning.layer_mpc import LayerMpc
from inkloop_controller.planning.layer_plan import LeftOut, PlanStatus
from inkloop_controller.problem.criterion import Work

SCANS = 50
LIMITS_S = {100: 0.02, 300: 0.1, 1000: 0.8, 2048: 4.0}
SIDES = (100, 300, 1000)
HEADINGS = ("grid", "the least", "limit", "wall, median", "wall, worst", "processor, worst", "plans", "left out")
LEAST_SCANS, NO_TIME_S = 3, 1e-9
HORIZON = 3
PITCH = 263.256e-6  # [m]
NOISE_M, VARIATION = 0.3e-6, 0.1  # of the scans; of the droplets


@dataclass(frozen=True)
class Answer:
    """Time that a scan waited for its pattern, and the plan."""

    wall_s: float
    processor_s: float
    status: str
    left_out: LeftOut


def measure(*, sides: tuple[int, ...] = SIDES, scans: int = SCANS) -> Table:
    """The worst of many scans of each grid."""
    title = f"time limit, from the scan to the pattern: worst of {scans} scans, N = {HORIZON}, one thread"
    table = table_of(title, HEADINGS)
    for side in sides:
        limit = LIMITS_S.get(side, LIMITS_S[SIDES[-1]] * (side / SIDES[-1]) ** 2)
        found = list(track(answers(side, limit, scans), description=f"{side} x {side}", total=scans, transient=True))
        walls = np.array([answer.wall_s for answer in found])
        processor = max(answer.processor_s for answer in found)
        plans = Counter(answer.status for answer in found)
        left_out = Counter(str(stage.name).lower() for answer in found for stage in answer.left_out)
        table.add_row(
            f"{side} x {side}",
            scaled(least(side)),
            scaled(limit),
            scaled(float(np.median(walls))),
            scaled(float(walls.max())),
            scaled(processor),
            _counts(plans),
            _counts(left_out),
        )
    return table


def least(side: int) -> float:
    """Wall time of an answer without any time: the estimate, nothing and one rounded plan [s]."""
    return float(np.median([answer.wall_s for answer in answers(side, NO_TIME_S, LEAST_SCANS)]))


def answers(side: int, limit: float, scans: int) -> Iterator[Answer]:
    """Layers of a print with that limit [s] for every plan; the scan of the start surface is not among them."""
    rng = np.random.default_rng(0)
    height = np.zeros((side, side))
    job = block(side, scans)
    planner = LayerMpc(job, horizon=HORIZON, work=Work(time_limit=limit))
    controller = LayerController(job, planner, HeightEstimator(job))
    controller.initialize(0, _scan(height, 0))
    pattern = controller.do_step(0, NS_PER_S, _scan(height, 0))["pattern"]
    for layer in range(1, 1 + scans):
        factor = 1.0 + VARIATION * rng.uniform(-1.0, 1.0, height.shape)
        height = bindings.layer(height, np.asarray(pattern, np.int32), job.inks, factor=factor)
        scan = _scan(height + NOISE_M * rng.standard_normal(height.shape), layer)
        outputs, processor, wall = timed(partial(controller.do_step, layer * NS_PER_S, NS_PER_S, scan))
        pattern = outputs["pattern"]
        yield Answer(wall, processor, list(PlanStatus)[int(outputs["plan_status"])], LeftOut(int(outputs["left_out"])))


def _scan(surface: FloatMap, layer: int) -> dict[str, Any]:
    number = np.int32(layer)
    counts = {"layers_scanned": number, "layers_printed": number, "layer_unknown": np.bool_(False)}
    return {"measured_height": surface, "valid": np.ones(surface.shape, np.bool_), **counts}


def block(side: int, scans: int) -> Job:
    """A block with a margin of two cells, too high to be done within these scans."""
    mask = np.zeros((side, side), np.bool_)
    mask[2:-2, 2:-2] = True
    plain = Job(side, side, PITCH, np.zeros(mask.shape), mask)
    top = (scans + 1.6) * nominal_layer_height(plain)
    return Job(side, side, PITCH, np.where(mask, top, 0.0), mask)


def _counts(found: Counter[str]) -> str:
    return ", ".join(f"{name} {count}" for name, count in found.items()) or "nothing"
