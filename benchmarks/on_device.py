"""A layer from its scan to the pattern of the next one: planned on a GPU, and on all cores of the processor."""

from __future__ import annotations

import os
from functools import partial
from importlib import import_module

import numpy as np
from rich.table import Table
from rich.text import Text

from benchmarks.timing import scaled, table_of, timed
from inkloop.component import FloatMap, Ink, Job
from inkloop.errors import InkloopError, require
from inkloop.units import M_PER_UM, UM_PER_M
from inkloop_controller.estimation.height_estimator import Estimate, HeightEstimator
from inkloop_controller.model import LayerModel
from inkloop_controller.planning.layer_mpc import LayerMpc
from inkloop_controller.problem.criterion import Criterion, Work
from inkloop_controller.problem.horizon_problem import IntMap, IntPlan

SIDES = (1000,)
HORIZONS = (1, 3, 5)
FULL_LAYERS = 4
"""Layers that have roughened the surface when the controller gets it."""
VARIATION = 0.2  # of each droplet, at most
NOISE = 0.3 * M_PER_UM
LACKING = 0.6
"""The target above the surface, in layers for each layer ahead."""


def measure(sides: tuple[int, ...] = SIDES) -> Table | Text:
    """Wall time and objective of both, alpha 1; a sentence where there is no GPU."""
    try:
        require("pyopencl", "a plan on a GPU")
        device = import_module("inkloop_controller.gpu.device")
        name = device.described(device.chosen_device())
    except InkloopError as error:
        return Text(str(error))
    cores = os.cpu_count() or 1
    table = table_of(
        f"a layer that is planned on {cores} cores and on {name}, kernels compiled, wall time",
        ("grid", "horizon", "estimate", "plan\ncores", "um", "plan\nGPU", "um", "scan to pattern\nGPU"),
        texts=1,
    )
    for side in sides:
        for layers in HORIZONS:
            table.add_row(f"{side} x {side}", str(layers), *_row(side, layers, cores))
    return table


def _row(side: int, layers: int, cores: int) -> tuple[str, ...]:
    """The second layer that is not full, planned by both from the plan of the first one."""
    rng, job = np.random.default_rng(0), _job(side, layers)
    plant, criterion = LayerModel.of(job), Criterion(layer_worth=0.0, droplet_std=0.0, overshoot=1.0)
    here, there = (
        LayerMpc(job, horizon=layers, criterion=criterion, work=Work(threads=cores), device=device)
        for device in ("cpu", "gpu")
    )
    estimator, seen = HeightEstimator(job, threads=cores), np.ones((side, side), np.bool_)
    height, pattern = np.zeros((side, side)), np.ones((side, side), np.int32)

    def printed(pattern: IntMap, number: int) -> tuple[FloatMap, FloatMap]:
        surface = plant.layer(height, pattern, number, 1.0 - VARIATION * rng.random(height.shape))
        return surface, surface + NOISE * rng.standard_normal(height.shape)

    estimate = estimator.first(height, seen)
    for number in range(1, FULL_LAYERS + 1):
        height, scan = printed(pattern, number)
        estimate = estimator.next(estimate, pattern, number, scan, seen)
    first = there.plan(estimate, FULL_LAYERS, np.zeros((0, side, side), np.int32))
    height, scan = printed(first.pattern, FULL_LAYERS + 1)
    estimate, _, estimated = timed(partial(estimator.next, estimate, first.pattern, FULL_LAYERS + 1, scan, seen))
    there.plan(estimate, FULL_LAYERS + 1, first.plan)  # compiles the kernels
    found, planned = zip(*(_plan(planner, estimate, first.plan) for planner in (here, there)), strict=True)
    return (
        scaled(estimated),
        *(
            text
            for value, wall in zip(found, planned, strict=True)
            for text in (scaled(wall), f"{value * UM_PER_M:.4f}")
        ),
        scaled(estimated + planned[1]),
    )


def _plan(planner: LayerMpc, estimate: Estimate, last: IntPlan) -> tuple[float, float]:
    """Objective [m] and wall time [s] of a plan, its pattern taken."""
    plan, _, wall = timed(partial(planner.plan, estimate, FULL_LAYERS + 1, last))
    pattern, _, taken = timed(lambda: plan.pattern)
    assert pattern.any()
    return plan.objective.value, wall + taken


def _job(side: int, layers: int) -> Job:
    """A part that fills its grid."""
    full = FULL_LAYERS * (1.0 - 0.5 * VARIATION)
    height = np.full((side, side), (full + 1.0 + LACKING * layers) * Ink().layer_height)
    return Job(side, side, 63.5 * M_PER_UM, height, np.ones((side, side), np.bool_))
