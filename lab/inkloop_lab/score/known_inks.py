"""Inks of a plant at three levels of knowledge: its volume only, one droplet, or the best fit to many layers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap, Ink
from inkloop.contract import HEIGHT, LAYER_COMMAND, PATTERN
from inkloop.scenario.file import Scenario
from inkloop.units import NS_PER_S
from inkloop_lab.identify.ink_regression import identify_ink
from inkloop_lab.identify.print_record import PrintRecord

STEP_NS = NS_PER_S
LAYERS, COVERAGE = 8, 0.7
"""Layers printed to identify an ink, and the share of the part's cells that get a droplet in each (assumed)."""
Pattern = NDArray[np.int32]


def surfaces(scenario: Scenario, patterns: Sequence[Pattern]) -> Iterator[FloatMap]:
    """Surfaces of patterns printed by the printer of a scenario, without controller and sensor: the start, then each
    layer [m].

    Raises ScenarioError, ComponentError.
    """
    components = scenario.build()
    printer = components["printer"]
    inputs = {port.name: port.start_value() for port in printer.inputs}
    try:
        yield np.array(printer.initialize(0, inputs)[HEIGHT])
        for number, pattern in enumerate(patterns):
            inputs |= {PATTERN: pattern, LAYER_COMMAND: np.asarray(number + 1, dtype=np.int32)}
            yield np.array(printer.do_step(number * STEP_NS, STEP_NS, inputs)[HEIGHT])
    finally:
        for component in components.values():
            component.terminate()


def single_droplet(scenario: Scenario) -> Ink:
    """Mean heights that one droplet on flat ground adds to its own cell, and to its side and corner neighbours.

    A model without flow, which adds droplets up, knows nothing else of a plant.
    """
    grid = scenario.tables.grid
    i, j = grid.nx // 2, grid.ny // 2
    pattern = np.zeros((grid.nx, grid.ny), dtype=np.int32)
    pattern[i, j] = 1
    before, after = surfaces(scenario, [pattern])
    left = (after - before)[i - 1 : i + 2, j - 1 : j + 2]
    sides, corners = left[[0, 1, 1, 2], [1, 0, 2, 1]].mean(), left[[0, 0, 2, 2], [0, 2, 0, 2]].mean()
    return Ink(float(left[1, 1]), float(sides), float(corners))


def layers_of(scenario: Scenario, seed: int = 1) -> PrintRecord:
    """Layers printed on top of each other, each with droplets on a random part of the part's cells, measured exactly.

    Raises ScenarioError, ComponentError.
    """
    job, rng = scenario.job(), np.random.default_rng(seed)
    patterns = [(job.mask & (rng.random(job.mask.shape) < COVERAGE)).astype(np.int32) for _ in range(LAYERS)]
    measured = np.stack(list(surfaces(scenario, patterns)))
    order = {name: getattr(job, name) for name in ("passes", "pass_order", "pass_rotation")}
    return PrintRecord(scenario.tables.title, job.pitch, np.stack(patterns), measured, **order)


def identified(scenario: Scenario, seed: int = 1) -> Ink:
    """The ink with which the layer-to-layer model predicts `layers_of` a plant best, by least squares over the grid."""
    return Ink(*(float(h) for h in identify_ink([layers_of(scenario, seed)], 0.0, correct=False).heights[0]))
