"""Processor time of the controller in a whole print: the estimate after each scan, and the plan made from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from rich.table import Table

from benchmarks.prints import SCENARIOS
from benchmarks.timing import scaled, table_of, timed
from inkloop.component import FloatMap, Job
from inkloop.scenario.file import Scenario
from inkloop_controller.estimation.height_estimator import HeightEstimator
from inkloop_controller.model import LayerModel
from inkloop_controller.planning.layer_mpc import LayerMpc
from inkloop_controller.problem.criterion import Criterion, Work
from inkloop_controller.problem.horizon_problem import IntMap

CYLINDER = SCENARIOS / "cylinder.toml"
VARIATION = 0.2  # of each droplet, at most
LAYERS_MAX = 120
HORIZON_3 = "horizon 3, every layer, no chance"
PLANNERS: dict[str, Callable[[Job], LayerMpc]] = {
    'finish = "even"': LayerMpc,
    'finish = "even", sweeps = 12': partial(LayerMpc, work=Work(sweeps=12)),
    'finish = "fast"': partial(LayerMpc, finish="fast"),
    HORIZON_3: partial(LayerMpc, horizon=3, criterion=Criterion(layer_worth=0.0, droplet_std=0.0, overshoot=1.0)),
}
"""The first one prints; all plan from its scans."""


@dataclass
class _Spent:
    """Seconds of processor time over a print."""

    estimator: float = 0.0
    planner: float = 0.0

    @property
    def total(self) -> float:
        return self.estimator + self.planner


def measure() -> Table:
    """Means over the layers of one print, on one thread; the same patterns and scans for all."""
    job = Scenario.load(CYLINDER).job()
    scans, patterns = _print(job)
    layers = len(scans)
    spent = {name: _replay(job, make(job), scans, patterns) for name, make in PLANNERS.items()}
    title = f"processor time of the controller per layer, cylinder of {layers - 1} layers, 20 % variation"
    table = table_of(title, ("plans", "estimate", "plan", "both", "relative to the last row"), texts=1)
    for name, found in spent.items():
        times = (scaled(each / layers) for each in (found.estimator, found.planner, found.total))
        table.add_row(name, *times, f"{found.total / spent[HORIZON_3].total:.2f}")
    return table


def _print(job: Job) -> tuple[list[FloatMap], list[IntMap]]:
    """Scans of all layers from the substrate on, and the pattern of the layer after each but the last."""
    controller, estimator, plant = LayerMpc(job), HeightEstimator(job), LayerModel.of(job)
    rng, seen = np.random.default_rng(job.seed), np.ones(job.mask.shape, np.bool_)
    scans, patterns = [np.zeros(job.mask.shape)], list[IntMap]()
    estimate, last = estimator.first(scans[0], seen), np.zeros((1, 0, 0), np.int32)
    while len(patterns) < LAYERS_MAX:
        plan = controller.plan(estimate, len(patterns), last)
        if not plan.pattern.any():
            break
        last, number = plan.plan, len(scans)
        patterns.append(plan.pattern)
        factor = 1.0 - VARIATION * rng.random(job.mask.shape)
        scans.append(plant.layer(scans[-1], plan.pattern, number, factor))
        estimate = estimator.next(estimate, plan.pattern, number, scans[-1], seen)
    return scans, patterns


def _replay(job: Job, controller: LayerMpc, scans: list[FloatMap], patterns: list[IntMap]) -> _Spent:
    """Estimates from these scans, and plans from the estimates, of which nothing is printed."""
    estimator, seen, spent = HeightEstimator(job), np.ones(job.mask.shape, np.bool_), _Spent()
    estimate, last = estimator.first(scans[0], seen), np.zeros((1, 0, 0), np.int32)
    for layer, scan in enumerate(scans):
        if layer > 0:
            estimate, seconds, _ = timed(partial(estimator.next, estimate, patterns[layer - 1], layer, scan, seen))
            spent.estimator += seconds
        plan, seconds, _ = timed(partial(controller.plan, estimate, layer, last))
        spent.planner += seconds
        last = plan.plan
    return spent
